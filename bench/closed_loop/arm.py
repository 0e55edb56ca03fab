"""
Arms in MuJoCo: rigid bodies with damping and Coulomb friction, and a position controller.

This code is independent of the package's own simulation. Each arm has a URDF.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import dataclass
from typing import Any

from bench.shared.runner import names, seeds
from gravity_comp_ros.data.samples import JointSamples
import mujoco
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

STEP = 0.001
GRAVITY = 9.81
# Standard deviation of the noise of effort, N·m, and speed, rad/s.
EFFORT_NOISE, SPEED_NOISE = 0.1, 0.001


@dataclass(frozen=True)
class Link:
    """A link: pose of its joint in the previous link, mass, centre, friction of the joint."""

    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float]
    mass: float
    centre: tuple[float, float, float]
    damping: float
    friction: float = 1.0


_H = np.pi / 2
SIX = (
    Link((0, 0, 0.16), (0, 0, 0), 4.1, (0.01, -0.02, 0.0), 6.0),
    Link((0, 0.14, 0), (0, _H, 0), 8.9, (0.0, 0.01, 0.28), 8.0),
    Link((0, -0.12, 0.42), (0, 0, 0), 2.9, (0.01, 0.0, 0.26), 5.0),
    Link((0, 0, 0.39), (0, _H, 0), 1.4, (0.0, 0.005, 0.02), 2.0),
    Link((0, 0.1, 0), (0, 0, 0), 1.4, (0.0, 0.0, 0.03), 2.0),
    Link((0, 0, 0.1), (_H, 0, 0), 0.5, (0.01, 0.0, 0.03), 1.0))
SEVEN = (
    Link((0, 0, 0.15), (0.3, -0.2, 0), 3.8, (0.0, -0.03, 0.12), 5.0),
    Link((0, 0, 0.19), (_H, 0, 0), 4.2, (0.0, 0.06, 0.04), 6.0),
    Link((0, 0.21, 0), (-_H, 0, 0), 3.1, (0.0, 0.03, 0.13), 4.0),
    Link((0, 0, 0.19), (_H, 0, 0), 2.9, (0.0, 0.07, 0.03), 4.0),
    Link((0, 0.21, 0), (-_H, 0, 0), 1.8, (0.0, 0.02, 0.08), 2.0),
    Link((0, 0.06, 0.19), (_H, 0, 0), 1.9, (0.0, 0.0, -0.04), 2.0),
    Link((0, 0.08, 0.06), (-_H, 0, 0), 0.4, (0.005, 0.0, 0.02), 1.0))
BUILDS = {'six': SIX, 'seven': SEVEN}


@dataclass(frozen=True)
class Load:
    """A body on the flange: `mass` in kg, `centre` in m in the frame of the last joint."""

    mass: float
    centre: tuple[float, float, float] = (0.02, -0.01, 0.1)


def urdf(links: tuple[Link, ...], load: Load | None = None) -> str:
    """Return the URDF of an arm, with a load fixed to its last link if there is one."""
    parts = ['<robot name="arm"><link name="base"/>']
    for k, link in enumerate(links):
        parent = f'link_{k}' if k else 'base'
        parts += [
            f'<joint name="joint_{k + 1}" type="revolute"><parent link="{parent}"/>'
            f'<child link="link_{k + 1}"/><origin xyz="{_text(link.xyz)}" '
            f'rpy="{_text(link.rpy)}"/><axis xyz="0 0 1"/>'
            f'<limit lower="-2.6" upper="2.6" effort="200" velocity="2"/>'
            f'<dynamics damping="{link.damping}" friction="{link.friction}"/></joint>',
            _body(f'link_{k + 1}', link.mass, link.centre, 0.02 + 0.01 * link.mass)]
    if load is not None:
        parts += [f'<joint name="load" type="fixed"><parent link="link_{len(links)}"/>'
                  f'<child link="load"/></joint>',
                  _body('load', load.mass, load.centre, 0.002 * load.mass)]
    return '\n'.join([*parts, '</robot>'])


def _body(name: str, mass: float, centre: tuple[float, ...], inertia: float) -> str:
    return (f'<link name="{name}"><inertial><origin xyz="{_text(centre)}"/>'
            f'<mass value="{mass}"/><inertia ixx="{inertia}" iyy="{inertia}" '
            f'izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>')


def _text(values: tuple[float, ...]) -> str:
    return ' '.join(f'{value:.12g}' for value in values)


class MujocoArm:
    """An arm with torque input; `seed` is that of the sensor noise."""

    def __init__(self, build: str, load: Load | None = None, seed: int = 0) -> None:
        self.links = BUILDS[build]
        self.joints = tuple(f'joint_{k + 1}' for k in range(len(self.links)))
        self.model = mujoco.MjModel.from_xml_string(urdf(self.links, load))
        self.model.opt.timestep = STEP
        self.model.opt.gravity[:] = 0.0, 0.0, -GRAVITY
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self.model.dof_armature[:] = 0.1
        self.data = mujoco.MjData(self.model)
        self.rng = np.random.default_rng([seed, len(self.links)])

    def place(self, q: FloatArray) -> None:
        """Set the arm at rest at a pose (N,) in rad."""
        self.data.qpos[:], self.data.qvel[:] = q, 0.0
        self.data.qacc_warmstart[:] = 0.0
        mujoco.mj_forward(self.model, self.data)

    @property
    def q(self) -> FloatArray:
        return np.array(self.data.qpos)

    @property
    def qd(self) -> FloatArray:
        return np.array(self.data.qvel)

    def measured(self, tau: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return measured position, speed and effort (N,)."""
        n = len(self.joints)
        return (self.q, self.qd + SPEED_NOISE * self.rng.normal(size=n),
                tau + EFFORT_NOISE * self.rng.normal(size=n))

    def step(self, tau: FloatArray) -> None:
        """Simulate `STEP` s with torques (N,) in N·m."""
        self.data.qfrc_applied[:] = tau
        mujoco.mj_step(self.model, self.data)

    def gravity(self, q: FloatArray) -> FloatArray:
        """Return the true gravity torque (M, N) in N·m at poses (M, N)."""
        data = mujoco.MjData(self.model)
        torques = []
        for pose in np.atleast_2d(q):
            data.qpos[:], data.qvel[:] = pose, 0.0
            mujoco.mj_forward(self.model, data)
            torques.append(np.array(data.qfrc_bias))
        return np.array(torques)


@dataclass(frozen=True)
class SlowPath:
    """A slow sine per joint, amplitude 0.5 to 0.7 rad, at most 0.13 rad/s."""

    amplitude: FloatArray
    omega: FloatArray
    phase: FloatArray
    centre: FloatArray

    @classmethod
    def random(cls, n_joints: int, seed: int) -> SlowPath:
        """Return the random path of a seed."""
        rng = np.random.default_rng([seed, 4])
        amplitude = rng.uniform(0.5, 0.7, n_joints)
        return cls(amplitude, rng.uniform(0.6, 1.0, n_joints) * 0.13 / amplitude,
                   rng.uniform(0.0, 2 * np.pi, n_joints), rng.uniform(-0.6, 0.6, n_joints))

    def at(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Return pose and speed (N,) at a time in s."""
        angle = self.omega * t + self.phase
        return (self.centre + self.amplitude * np.sin(angle),
                self.amplitude * self.omega * np.cos(angle))


class Controller:
    """PD control of joint positions, without any gravity term."""

    def __init__(self, n_joints: int) -> None:
        self.kp = np.full(n_joints, 3000.0)
        self.kd = np.full(n_joints, 60.0)

    def torque(self, arm: MujocoArm, q: FloatArray, qd: FloatArray) -> FloatArray:
        """Return torques (N,) in N·m towards a pose and speed."""
        return np.asarray(self.kp * (q - arm.q) + self.kd * (qd - arm.qd))


RATE = 100.0


def record(arm: MujocoArm, path: SlowPath, start: float, duration: float) -> JointSamples:
    """Return the measurements of an arm that follows a path from time `start`, at 100 Hz."""
    control = Controller(len(arm.joints))
    arm.place(path.at(start)[0])
    every, rows = round(1.0 / (RATE * STEP)), []
    # One second at rest for the controller to converge.
    for k in range(-1000, round(duration / STEP)):
        t = start + max(k, 0) * STEP
        q, qd = path.at(t)
        tau = control.torque(arm, q, qd if k >= 0 else 0.0 * qd)
        if k >= 0 and k % every == 0:
            rows.append((t, *arm.measured(tau)))
        arm.step(tau)
    t, q, qd, tau = (np.array(part) for part in zip(*rows))
    return JointSamples.single_run(arm.joints, t, q, qd, tau)


def builds_and_seeds(parser: ArgumentParser) -> None:
    """Add the options of each bench in MuJoCo."""
    parser.add_argument('--builds', type=names, default=','.join(BUILDS))
    parser.add_argument('--seeds', type=seeds, default='11-13', help='(default: %(default)s)')


def each(args: Namespace, *more: Any) -> dict[str, tuple[Any, ...]]:
    """Return the arguments of each build and seed, with further ones, by the name of the case."""
    return {'.'.join(map(str, (build, seed, *more))): (build, seed, *more)
            for build in args.builds for seed in args.seeds}
