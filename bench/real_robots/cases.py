"""
A case: an arm, three runs of slow motion, hidden effects, and the truth.

    from bench.real_robots.cases import case
    one = case('panda', 400)                # the same arrays every time
    one.train[0].q, one.train[0].tau        # (4500, 7) in rad and N·m; also .t and .qd
    one.unseen                              # the third run
    one.hidden, one.noise, one.urdf         # truth, noise (N,) in N·m, serial chain
    low, high = one.static(q)               # true torque at rest, (K, N) in N·m

Each run has 90 s at 50 Hz, a multisine within a box of poses that is drawn once for a case, at
most 0.15 rad/s. The torque is that of the full rigid-body dynamics (Pinocchio's RNEA), friction,
hidden effects and white noise: 0.1 to 0.2 % of the scale of the joint (see `laws`). Positions
have a noise of 1e-5 rad, velocities of 2e-4 rad/s. Two of three cases have LuGre friction on
every joint, half of the cases two hidden effects on different joints.

An effect is redrawn while it is collinear with dynamics: after projection on Pinocchio's
regressor, and Coulomb and viscous friction of the joint where it is another effect, at least one
standard deviation of the noise must remain (rms). `Case.visible` is that residual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from zlib import crc32

from bench.real_robots.arms import arm_of, urdf
from bench.real_robots.laws import (
    gear_friction, Hidden, level_of, MAKERS, Site, with_one_level)
from bench.shared.findings import Known
from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.simulation.arms import Arm, gravity_torque
from gravity_comp_ros.simulation.disturbances.friction import Friction, JointFriction
from gravity_comp_ros.simulation.motions import Motion, multisine, MultisineOptions
from gravity_comp_ros.simulation.synthesise import Disturbance, synthesise, SynthesisOptions
import numpy as np
import pinocchio as pin

DURATION, RATE, MAX_SPEED = 90.0, 50.0, 0.15
# Noise of positions in rad and velocities in rad/s.
_POSITION_NOISE, _VELOCITY_NOISE = 1e-5, 2e-4
# Width of the box of poses in rad.
_WIDTH = (0.7, 1.2)
# Slower sines than by default, which fill the box of poses at this speed: band in Hz, number.
_BAND, _SINES = 0.07, 4
# Poses of the trained box in which static torques are compared.
_POSES = 500
# Least rms of an effect after that projection, in noise levels.
_VISIBLE = 1.0


@dataclass(frozen=True, eq=False)
class Run:
    """Samples of one run: `t` (M,) in s; `q`, `qd`, `tau` (M, N) in rad, rad/s and N·m."""

    t: FloatArray
    q: FloatArray
    qd: FloatArray
    tau: FloatArray


@dataclass(frozen=True, eq=False)
class Case:
    """
    One case; `train` are two runs, `unseen` is a third one, `motions` are exact.

    `joints` are the N names, base first; `noise` and `scale` (N,) in N·m; `largest` the largest
    gravity torque of the arm within its limits, N·m. `friction` is that of every joint, empty in
    one of three cases. `visible` is the rms of each hidden effect beyond rigid-body dynamics and
    friction, in noise levels. `poses` (K, N) are in the trained box.
    """

    arm: str
    seed: int
    urdf: str
    joints: tuple[str, ...]
    motions: tuple[Motion, ...]
    train: tuple[Run, ...]
    unseen: Run
    hidden: tuple[Hidden, ...]
    friction: tuple[Friction, ...]
    visible: tuple[float, ...]
    noise: FloatArray
    scale: FloatArray
    largest: float
    poses: FloatArray

    @property
    def name(self) -> str:
        return f'{self.arm}.{self.seed}'

    @property
    def known(self) -> tuple[Known, ...]:
        """Return the true coefficients: of hidden effects, and the friction of other joints."""
        joints = {one.joint for one in self.hidden}
        return (*(one.known for one in self.hidden if one.known is not None),
                *(level_of(one, MAX_SPEED) for one in self.friction if one.joint not in joints))

    @property
    def has_lugre(self) -> BoolArray:
        """Return whether a joint has LuGre friction, its own or a hidden one, (N,)."""
        laws = (*self.friction, *(one.law for one in self.hidden
                                  if isinstance(one.law, JointFriction)))
        return np.isin(np.arange(len(self.joints)), [law.joint for law in laws])

    def static(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return bounds (K, N) in N·m of the true torque at rest in poses q (K, N) in rad."""
        arm = arm_of(self.urdf)
        still = Motion('at rest', np.arange(len(q), dtype=np.float64), q, 0 * q, 0 * q,
                       lambda t: (q, 0 * q, 0 * q))
        laws = [one.law for one in self.hidden if one.static]
        tau = synthesise(arm, still, SynthesisOptions(static=True, disturbances=laws)).tau
        slack = np.zeros(len(self.joints))
        for one in self.hidden:
            slack[one.joint] += one.slack
        return tau + np.minimum(slack, 0.0), tau + np.maximum(slack, 0.0)


@dataclass(frozen=True, eq=False)
class Setting:
    """
    What the runs of a case have in common: the arm, its noise, and its box of poses.

    `scale` and `noise` (N,) and `largest`, the largest gravity torque of the arm, in N·m; `low`
    and `high` (N,) in rad. `rng` is the source of all that is drawn after it.
    """

    arm: Arm
    rng: np.random.Generator
    scale: FloatArray
    largest: float
    noise: FloatArray
    low: FloatArray
    high: FloatArray

    @staticmethod
    def drawn(arm: Arm, rng: np.random.Generator) -> Setting:
        """Return a random setting of an arm."""
        scale, largest = scales(arm)
        noise = rng.uniform(0.001, 0.002, arm.n_joints) * scale
        width = np.minimum(rng.uniform(*_WIDTH, arm.n_joints), 0.95 * (arm.upper - arm.lower))
        low = rng.uniform(arm.lower, arm.upper - width)
        return Setting(arm, rng, scale, largest, noise, low, low + width)

    def sites(self) -> list[Site]:
        """Return the joints with their scales and boxes of poses."""
        return [Site(j, *map(float, row)) for j, row in enumerate(zip(
            self.scale, self.low, self.high, self.arm.lower, self.arm.upper))]

    def friction(self) -> tuple[Friction, ...]:
        """Return LuGre friction on every joint in two of three cases."""
        if self.rng.random() >= 2 / 3:
            return ()
        return tuple(gear_friction(site, self.rng) for site in self.sites())

    def motion(self) -> Motion:
        """Return slow motion of one run within the box of poses."""
        return multisine(self.low, self.high, self.arm.max_speed,
                         int(self.rng.integers(2 ** 31)),
                         MultisineOptions(MAX_SPEED, DURATION, _BAND, _SINES), DURATION, RATE)

    def run(self, laws: Sequence[Disturbance], motion: Motion | None = None,
            arm: Arm | None = None) -> Run:
        """Return a run in a motion, a drawn one if not given, of this arm or of a changed one."""
        motion = self.motion() if motion is None else motion
        return recorded(arm or self.arm, motion, laws, self.noise, self.rng)


def generator(name: str, seed: int, *salt: int) -> np.random.Generator:
    """Return the random numbers of an arm and a seed; each bench has its own salt."""
    return np.random.default_rng([seed, crc32(name.encode()), *salt])


def case(name: str, seed: int) -> Case:
    """
    Return the case of an arm and a seed.

    :raises OptionError: if there is no such arm, or the descriptions are not installed.
    """
    rng = generator(name, seed)
    one = Setting.drawn(arm_of(urdf(name)), rng)
    motions = tuple(one.motion() for _ in range(3))
    friction = one.friction()
    hidden, visible = _hidden(one, motions[:2], bool(friction))
    # Friction of a hidden law replaces that of the gear.
    replaced = {effect.joint for effect in hidden if isinstance(effect.law, Friction)}
    friction = tuple(law for law in friction if law.joint not in replaced)
    # Friction first: a gain acts on the torque that the sensor measures.
    laws = [*friction, *(effect.law for effect in hidden)]
    runs = tuple(one.run(laws, motion) for motion in motions)
    return Case(name, seed, urdf(name), one.arm.joints, motions, runs[:2], runs[2], hidden,
                friction, visible, one.noise, one.scale, one.largest, trained(runs[:2], rng))


def trained(runs: Sequence[Run], rng: np.random.Generator) -> FloatArray:
    """Return random poses (K, N) in rad within those of runs."""
    q = np.concatenate([run.q for run in runs])
    return rng.uniform(q.min(axis=0), q.max(axis=0), (_POSES, q.shape[1]))


def scales(arm: Arm) -> tuple[FloatArray, float]:
    """Return the scale (N,) of each joint and the largest gravity torque of the arm, N·m."""
    poses = np.random.default_rng(0).uniform(arm.lower, arm.upper, (500, arm.n_joints))
    size = np.abs(gravity_torque(arm, poses)).max(axis=0)
    return np.maximum(size, 0.1 * size.max()), float(size.max())


def recorded(arm: Arm, motion: Motion, laws: Sequence[Disturbance], noise: FloatArray,
             rng: np.random.Generator) -> Run:
    """Return the sensor data of an arm in motion; `noise` (N,) in N·m."""
    exact = synthesise(arm, motion, SynthesisOptions(disturbances=laws))
    shape = exact.q.shape
    return Run(exact.t, exact.q + _POSITION_NOISE * rng.standard_normal(shape),
               exact.qd + _VELOCITY_NOISE * rng.standard_normal(shape),
               exact.tau + noise * rng.standard_normal(shape))


def _hidden(setting: Setting, motions: Sequence[Motion], friction: bool
            ) -> tuple[tuple[Hidden, ...], tuple[float, ...]]:
    """Return one or two effects on different joints, and how visible each is."""
    arm, noise, rng, sites = setting.arm, setting.noise, setting.rng, setting.sites()
    makers = MAKERS[:-1] if friction else MAKERS
    sparse = [_every(motion, 10) for motion in motions]
    basis = np.concatenate([regressor(arm, motion) for motion in sparse]) / noise[:, None]
    basis = basis.reshape(-1, basis.shape[2])
    drawn: list[tuple[Hidden, float]] = []
    for _ in range(int(rng.integers(1, 3))):
        for _attempt in range(200):
            site = sites[int(rng.integers(len(sites)))]
            one = makers[int(rng.integers(len(makers)))](site, rng)
            if site.joint in {other.joint for other, _ in drawn}:
                continue
            rms = beyond(arm, sparse, one, basis, noise)
            if rms >= _VISIBLE:
                drawn.append((one, rms))
                break
    return tuple(one for one, _ in drawn), tuple(rms for _, rms in drawn)


def beyond(arm: Arm, motions: list[Motion], one: Hidden, basis: FloatArray,
           noise: FloatArray) -> float:
    """
    Return the rms of an effect beyond rigid-body dynamics and friction, in noise levels.

    Friction has the bristles of the effect, if it has any, at one level.
    """
    added = _torque_of(arm, motions, one.law) / noise
    if one.effect != 'coulomb_friction':
        qd = np.concatenate([motion.qd[:, one.joint] for motion in motions])
        friction = np.zeros((*added.shape, 3))
        friction[:, one.joint, :2] = np.column_stack([np.sign(qd), qd / MAX_SPEED])
        level = with_one_level(one.law)
        if level is not None:
            friction[..., 2] = _torque_of(arm, motions, level) / noise
        basis = np.column_stack([basis, friction.reshape(-1, 3)])
    rest = added.ravel() - basis @ np.linalg.lstsq(basis, added.ravel(), rcond=1e-8)[0]
    return float(np.sqrt((rest ** 2).sum() / len(added)))


def _torque_of(arm: Arm, motions: list[Motion], law: Disturbance) -> FloatArray:
    """Return the torque (M, N) in N·m of a law."""
    return np.concatenate([synthesise(arm, motion, SynthesisOptions(disturbances=[law])).tau
                           - synthesise(arm, motion).tau for motion in motions])


def _every(motion: Motion, step: int) -> Motion:
    return replace(motion, t=motion.t[::step], q=motion.q[::step], qd=motion.qd[::step],
                   qdd=motion.qdd[::step])


def regressor(arm: Arm, motion: Motion) -> FloatArray:
    """Return Pinocchio's regressor (M, N, 10 N) of the torque."""
    data = arm.model.createData()
    return np.array([pin.computeJointTorqueRegressor(arm.model, data, *row)
                     for row in zip(motion.q, motion.qd, motion.qdd)])
