"""Three-joint arm with its gravity model, and recordings with open targets."""

from dataclasses import replace

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain, expand
import numpy as np

NAMES = ('shoulder', 'elbow', 'wrist')
_ABOUT_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
CHAIN = Chain(np.array([_ABOUT_Y, np.eye(3), np.eye(3)]),
              np.array([[12.0, 0.0], [6.0, 0.5], [2.0, 0.0]]))
NOISE = 0.05


def model() -> GravityModel:
    """Return the gravity of three parallel axes."""
    gravity = GravityModel.from_energy(NAMES, 'chain', expand(CHAIN), np.full(3, NOISE),
                                       Coverage(np.full(3, -1.0), np.full(3, 1.0), 1000), {})
    return GravityModel(gravity.joints, 'chain', gravity.torques, gravity.energy, gravity.noise,
                        gravity.coverage, {}, CHAIN)


def uncertain_model(std: float = 0.2) -> GravityModel:
    """Return the same with standard deviation `std` of every parameter."""
    gravity = model()
    return replace(gravity, covariance=std ** 2 * np.eye(12))


def one_way(seed: int = 0, duration: float = 30.0, rate: float = 50.0, friction: float = 0.0,
            span: float = 1.0) -> JointSamples:
    """Return a recording in which every joint moves in one direction at varying speed."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 1.0 / rate)
    x, waves = t[:, None] / duration, np.array([1.0, 2.0, 3.0])
    q = span * (x - 0.5 + 0.8 * np.sin(2 * np.pi * waves * x) / (2 * np.pi * waves))
    qd = span / duration * (1.0 + 0.8 * np.cos(2 * np.pi * waves * x))
    tau = CHAIN.torque(q) + friction * np.sign(qd) + NOISE * rng.normal(size=q.shape)
    return JointSamples.single_run(NAMES, t, q, qd, tau, 'old')


def played(trajectory: Trajectory, seed: int = 1, friction: float = 0.0) -> JointSamples:
    """Return the recording of a trajectory."""
    q, qd = trajectory.q, trajectory.qd
    noise = NOISE * np.random.default_rng(seed).normal(size=q.shape)
    tau = CHAIN.torque(q) + friction * np.tanh(qd / 0.002) + noise
    return JointSamples.single_run(NAMES, trajectory.t, q, qd, tau, 'new')
