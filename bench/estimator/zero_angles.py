"""
Gravity of arms with zero-angle offsets between encoders and robot description.

    python -m bench.estimator.zero_angles --seeds 11,12

Each arm is recorded for 60 s of slow motion, with and without friction, with an offset of random
sign on every joint. A line has the RMS error of the worst joint in N·m over the whole joint range
with the description and without, whether the description was kept, and the largest error of the
estimated offsets of the inner joints in degrees. Seeds 1 and 2 were used for tuning.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
import sys

from bench.estimator.fast_motion import TEST_ARMS, worst_error
from bench.estimator.mounted import slow_motion
from bench.planning.scenes import ARMS, known_axes
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import fit_model
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import zero_angle_differences
from gravity_comp_ros.simulation.arms import Arm
import numpy as np


def main() -> int:
    """Print a line for each recording."""
    parser = argparse.ArgumentParser(description='Arms with zero-angle offsets.')
    parser.add_argument('--arms', default=TEST_ARMS)
    parser.add_argument('--seeds', default='11,12')
    parser.add_argument('--angles', default='0,0.3,1,3', help='degrees')
    args = parser.parse_args()
    for name in args.arms.split(','):
        arm = ARMS[name]()
        for seed in map(int, args.seeds.split(',')):
            for angle in map(float, args.angles.split(',')):
                signs = np.random.default_rng(seed).choice([-1.0, 1.0], arm.n_joints)
                for friction in (0.0, 0.01):
                    print(name, seed, f'{angle:g}', friction,
                          measured(arm, seed, friction, np.radians(angle) * signs), flush=True)
    return 0


def measured(arm: Arm, seed: int, friction: float, offsets: FloatArray) -> str:
    """Return a text of the errors of fits with and without the description."""
    samples = slow_motion(arm, seed, friction)
    recording = Recording(replace(samples, q=samples.q - offsets))
    axes = known_axes(arm)
    known, free = (fit_model(recording, FitOptions(geometry=geometry))[0].model
                   for geometry in (axes, None))
    if known.geometry is None:
        description = 'dropped '
    else:
        error = zero_angle_differences(axes.rotations, known.geometry.rotations) - offsets
        description = f'kept off by {np.degrees(np.abs(error[1:-1]).max(initial=0.0)):.2f}'
    return (f'{worst(arm, known, offsets):.3f} without {worst(arm, free, offsets):.3f} '
            f'{description}')


def worst(arm: Arm, model: GravityModel, offsets: FloatArray) -> float:
    """Return the worst joint's RMS error in N·m over the whole joint range."""
    return worst_error(arm, lambda q: model.predict(q - offsets))


if __name__ == '__main__':
    sys.exit(main())
