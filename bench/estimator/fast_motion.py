"""
Gravity from fast motion over the joint range, jointly with dynamics.

    python -m bench.estimator.fast_motion --seeds 21,22

Each arm is recorded three times: 60 s at up to 1 rad/s without friction, 60 s at up to 1 rad/s
with quicker reversals and friction, and 30 s at up to 0.6 rad/s with friction. A line has the RMS
error of the worst joint in N·m, with known and with unknown axes.
Seeds 0 to 7 and 20 were used for tuning.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import sys
import time

from bench.planning.scenes import ARMS, known_axes
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import Arm, gravity_torque
from gravity_comp_ros.simulation.disturbances.friction import Friction, LuGre
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np

TEST_ARMS = 'iiwa7,six_axis,right_seven,right_six,any_six'
# Maximum speed in rad/s, band in Hz, friction as a share of gravity's range, duration in s.
RECORDINGS = ((1.0, 0.3, 0.0, 60.0), (1.0, 0.8, 0.02, 60.0), (0.6, 0.3, 0.02, 30.0))
# Sampling rate in Hz; noise and minimum friction in N·m.
_RATE, _NOISE, _MIN_FRICTION = 50.0, 0.1, 0.1


def main() -> int:
    """Print a line for each recording."""
    parser = argparse.ArgumentParser(description='Gravity of fast motion.')
    parser.add_argument('--arms', default=TEST_ARMS)
    parser.add_argument('--seeds', default='21,22')
    args = parser.parse_args()
    for name in args.arms.split(','):
        arm = ARMS[name]()
        for seed in map(int, args.seeds.split(',')):
            for kind in RECORDINGS:
                print(name, seed, *kind, *measured(arm, recorded(arm, seed, *kind)), flush=True)
    return 0


def measured(arm: Arm, samples: JointSamples) -> list[str]:
    """Return a text of errors with known and unknown axes, and the processor time."""
    texts = []
    for title, axes in (('known', known_axes(arm)), ('unknown', None)):
        options = FitOptions(geometry=axes)
        started = time.process_time()
        error = worst(arm, fit(samples, options).model)
        texts.append(f'{title} {error:.3f} ({time.process_time() - started:.1f} s)')
    return texts


def recorded(arm: Arm, seed: int, speed: float, band: float, friction: float,
             seconds: float, minimum_friction: float = _MIN_FRICTION, share: float = 0.6
             ) -> JointSamples:
    """Return motion over a share of all joint ranges, up to `speed` rad/s and `band` Hz."""
    motion = motions.multisine(share * arm.lower, share * arm.upper, np.full(arm.n_joints, speed),
                               seed, motions.MultisineOptions(band, seconds), seconds, _RATE)
    levels = np.maximum(friction * np.ptp(gravity_torque(arm, poses(arm)), axis=0),
                        minimum_friction)
    disturbances = tuple(Friction(n, LuGre(float(level), float(level)))
                         for n, level in enumerate(levels) if friction)
    return synthesise(arm, motion, SynthesisOptions(NoiseOptions(0.0, _NOISE), seed,
                                                    disturbances=disturbances))


def worst(arm: Arm, model: GravityModel) -> float:
    """Return the worst joint's RMS error of gravity over the joint range, in N·m."""
    return worst_error(arm, model.predict)


def worst_error(arm: Arm, predict: Callable[[FloatArray], FloatArray]) -> float:
    """Return the same of a function of poses (M, N)."""
    q = poses(arm)
    return float(np.sqrt(((predict(q) - gravity_torque(arm, q)) ** 2).mean(axis=0)).max())


def poses(arm: Arm) -> FloatArray:
    """Return poses (M, N) over the whole joint range."""
    return np.random.default_rng(0).uniform(arm.lower, arm.upper, (1000, arm.n_joints))


if __name__ == '__main__':
    sys.exit(main())
