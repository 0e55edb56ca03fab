"""Motion of simulated arms: random states, recordings, and the error of a fit."""

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.arms import Arm, gravity_torque
from gravity_comp_ros.simulation.disturbances.friction import Friction, LuGre
from gravity_comp_ros.simulation.motions import multisine, MultisineOptions
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np

FAST = MultisineOptions(band=0.8, max_speed=1.5)
# Standard deviation of the torque in a recording, in N·m.
NOISE = 0.05


def drawn(n, count, seed):
    rng = np.random.default_rng(seed)
    return (rng.uniform(-3, 3, (count, n)), rng.normal(size=(count, n)),
            2.0 * rng.normal(size=(count, n)))


def of_motion(arm, q, qd, qdd):
    """Return the torque (M, N) in addition to gravity."""
    return arms.inverse_dynamics(arm, q, qd, qdd) - arms.gravity_torque(arm, q)


def recording(arm, seed, duration, rate=100.0):
    """Return fast motion with LuGre friction on every joint."""
    size = 0.05 * np.abs(arms.gravity_torque(arm, np.random.default_rng(0).uniform(
        arm.lower, arm.upper, (200, arm.n_joints)))).max(axis=0)
    friction = [Friction(n, LuGre(max(float(x), 0.2), max(float(x), 0.2)))
                for n, x in enumerate(size)]
    motion = multisine(arm.lower, arm.upper, np.full(arm.n_joints, 2.0), seed, FAST, duration,
                       rate)
    return synthesise(arm, motion, SynthesisOptions(NoiseOptions(absolute=NOISE), seed,
                                                    disturbances=friction))


def moved(arm: Arm, seed: int, speed: float, band: float, friction: float,
          seconds: float, minimum_friction: float = 0.1, share: float = 0.6) -> JointSamples:
    """Return motion over a share of all joint ranges, up to `speed` rad/s and `band` Hz."""
    motion = motions.multisine(share * arm.lower, share * arm.upper, np.full(arm.n_joints, speed),
                               seed, motions.MultisineOptions(band, seconds), seconds, 50.0)
    levels = np.maximum(friction * np.ptp(gravity_torque(arm, range_poses(arm)), axis=0),
                        minimum_friction)
    disturbances = tuple(Friction(n, LuGre(float(level), float(level)))
                         for n, level in enumerate(levels) if friction)
    return synthesise(arm, motion, SynthesisOptions(NoiseOptions(0.0, 0.1), seed,
                                                    disturbances=disturbances))


def worst(arm: Arm, model: GravityModel) -> float:
    """Return the worst joint's RMS error of gravity over the joint range, in N·m."""
    q = range_poses(arm)
    return float(np.sqrt(((model.predict(q) - gravity_torque(arm, q)) ** 2).mean(axis=0)).max())


def range_poses(arm: Arm) -> FloatArray:
    """Return 1000 poses (M, N) over the whole joint range."""
    return np.random.default_rng(0).uniform(arm.lower, arm.upper, (1000, arm.n_joints))
