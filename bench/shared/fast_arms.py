"""Fast motion of simulated arms: random states, inertial torque, and a recording."""

from gravity_comp_ros.simulation import arms
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
