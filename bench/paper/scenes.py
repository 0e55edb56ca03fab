"""
Training and test data: the arm of Yu 2022, Table 1, and a substitute for the paper's real arm.

The paper's real arm is not public and its Table 6 partly illegible. The substitute is the iiwa
with masses and centres that differ from the tables (by up to 3 % and 5 mm), inertia, Coulomb
friction and noise of 0.3 N·m. Payloads of 1.8, 2 and 4 kg are attached to its last link.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np
from numpy.typing import NDArray
import pinocchio as pin

FloatArray = NDArray[np.float64]

# Coulomb friction and standard deviation of the noise, in N·m.
FRICTION = NOISE = 0.3
# Velocity scale, in rad/s, of the sign change of Coulomb friction.
_WIDTH = 0.002
# Numbers of training samples, of test poses, and of poses within the joint limits.
_TRAINING, _TEST, _ANYWHERE = 500, 200, 1000
# Mass in kg and centre of mass in m.
PAYLOADS = {'1.8 kg, off the axis (a polishing tool)': (1.8, (0.03, 0.02, 0.12)),
            '2 kg (counterweight)': (2.0, (0.0, 0.0, 0.1)),
            '4 kg (counterweights)': (4.0, (0.0, 0.0, 0.1))}


@dataclass(frozen=True)
class Reference:
    """Test poses `q` (M, N) with their exact gravity `truth` and `measured` torque in N·m."""

    q: FloatArray
    truth: FloatArray
    measured: FloatArray


@dataclass(frozen=True)
class Scene:
    """
    Training samples, and test poses `inside` the trained range and `anywhere` within joint limits.

    `nominal` is the arm of the description. `unloaded` are samples without the payload,
    `first_loaded` those of the first seconds with it.
    """

    nominal: arms.Arm
    train: JointSamples
    inside: Reference
    anywhere: Reference
    unloaded: JointSamples | None = None
    first_loaded: JointSamples | None = None


def simulated(seed: int) -> Scene:
    """Return Table 3: random poses with 1 % noise, tested on Eq. (15)."""
    arm = arms.iiwa7()
    rng = np.random.default_rng([seed, 3])
    q = motions.random_poses(arm.lower, arm.upper, 1000, seed).q
    tau = arms.gravity_torque(arm, q)
    train = JointSamples.single_run(arm.joints, 2.0 * np.arange(len(q)), q, np.zeros_like(q),
                                    tau * (1.0 + 0.01 * rng.normal(size=tau.shape)))
    return Scene(arm, train, _exact(arm, motions.eq15().q[:_TEST]), _anywhere(arm))


def small_motion(seed: int) -> Scene:
    """Return 100 s of Eq. (17) with 0.1 N·m of noise, gravity alone; tested later on it."""
    arm = arms.iiwa7()
    train = synthesise(arm, motions.eq17(), SynthesisOptions(
        static=True, seed=seed, noise=NoiseOptions(absolute=0.1)))
    later = motions.eq17(start=100.0).q
    poses = motions.random_poses(arm.lower, arm.upper, _ANYWHERE, seed=1234).q
    return Scene(arm, train, _exact(arm, later), _exact(arm, poses))


def friction_test(joint: int, count: int = 200) -> tuple[float, float]:
    """
    Return the RSE of Eq. (18) of slow motion of a joint (from 0), forward and reverse.

    RSE is the squared difference from the torque at rest over the squared deviation of that from
    its mean. The joint moves over ±1 rad at 0.1 rad/s, the others are fixed.
    """
    arm = real_arm()
    q = np.tile([0.0, 0.4, 0.0, -0.7, 0.0, 0.5, 0.0], (count, 1))
    q[:, joint] += np.linspace(-1.0, 1.0, count)
    rng = np.random.default_rng(joint)
    static = arms.gravity_torque(arm, q)[:, joint] + NOISE * rng.normal(size=count)
    rse = []
    for direction in (1.0, -1.0):
        qd = np.zeros_like(q)
        qd[:, joint] = 0.1 * direction
        tau = arms.inverse_dynamics(arm, q, qd, np.zeros_like(q))[:, joint]
        tau = tau + direction * FRICTION + NOISE * rng.normal(size=count)
        rse.append(float(((tau - static) ** 2).sum() / ((static - static.mean()) ** 2).sum()))
    return rse[0], rse[1]


def real_arm() -> arms.Arm:
    """Return the iiwa with deviations of its masses and centres from the tables."""
    arm = arms.iiwa7()
    rng = np.random.default_rng(2022)
    model = arm.model.copy()
    for body in range(1, model.njoints):
        old = model.inertias[body]
        model.inertias[body] = pin.Inertia(old.mass * (1.0 + rng.uniform(-0.03, 0.03)),
                                           old.lever + rng.uniform(-0.005, 0.005, 3), old.inertia)
    return arms.Arm('built', arm.joints, model, arm.lower, arm.upper, arm.max_speed)


def real(seed: int, payload: str | None = None) -> Scene:
    """Return Tables 4 and 8, or Table 5 with a payload: 100 s of Eq. (17), tested later on it."""
    bare = real_arm()
    arm = bare if payload is None else arms.with_payload(bare, arms.Payload(*PAYLOADS[payload]))
    train = _recorded(arm, [seed, 4], 0.0, _TRAINING)
    later = motions.eq17(start=300.0, duration=_TEST / 5)
    # Later poses outside the trained range are not test poses of `inside`.
    low, high = train.q.min(axis=0), train.q.max(axis=0)
    within = ((later.q >= low) & (later.q <= high)).all(axis=1)
    measured = _recorded(arm, [seed, 5], 300.0, _TEST).tau
    inside = Reference(later.q[within], arms.gravity_torque(arm, later.q[within]),
                       measured[within])
    return Scene(arms.iiwa7(), train, inside, _anywhere(arm),
                 None if payload is None else _recorded(bare, [seed, 6], 0.0, _TRAINING),
                 None if payload is None else _recorded(arm, [seed, 7], 100.0, 50))


def _recorded(arm: arms.Arm, seed: list[int], start: float, count: int) -> JointSamples:
    motion = motions.eq17(start=start, duration=count / 5)
    tau = arms.inverse_dynamics(arm, motion.q, motion.qd, motion.qdd)
    tau += FRICTION * np.tanh(motion.qd / _WIDTH)
    tau += NOISE * np.random.default_rng(seed).normal(size=tau.shape)
    return JointSamples.single_run(arm.joints, motion.t, motion.q, motion.qd, tau)


def _anywhere(arm: arms.Arm) -> Reference:
    return _exact(arm, np.random.default_rng(1234).uniform(
        arm.lower, arm.upper, (_ANYWHERE, arm.n_joints)))


def _exact(arm: arms.Arm, q: FloatArray) -> Reference:
    truth = arms.gravity_torque(arm, q)
    return Reference(q, truth, truth)
