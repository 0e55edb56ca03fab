"""
Gravity of arms whose joints count their angles from elsewhere than their description.

    python -m bench.estimator.zero_angles --seeds 11,12

Each arm is recorded for 60 s of slow motion, with and without friction, its zero angles off by an
angle of a sign drawn at random on every joint. A line has the RMS error of the worst joint in N·m
over the whole joint range with the description and without, whether the description was kept, and
how far the zero angles of the inner joints are off that it ends up with, in degrees. Seeds 1 and 2
were looked at while the search for zero angles was made.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
import sys

from bench.estimator.fast_motion import JUDGED, poses
from bench.estimator.mounted import recorded
from bench.planning.scenes import ARMS, known_axes
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import fit_model
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation.fit import FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.zero_angles import zero_angle_differences
from gravity_comp_ros.simulation.arms import Arm, gravity_torque
import numpy as np


def main() -> int:
    """Print a line for each recording."""
    parser = argparse.ArgumentParser(description='Arms with zero angles of their own.')
    parser.add_argument('--arms', default=JUDGED)
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


def measured(arm: Arm, seed: int, friction: float, zero: FloatArray) -> str:
    """Return the errors of fits with and without the description, in words."""
    samples = recorded(arm, seed, friction)
    recording = Recording(replace(samples, q=samples.q - zero))
    axes = known_axes(arm)
    known, free = (fit_model(recording, FitOptions(geometry=each))[0].model
                   for each in (axes, None))
    kept = known.geometry is not None
    off = ''
    if known.geometry is not None:
        error = zero_angle_differences(axes.rotations, known.geometry.rotations) - zero
        off = f'off by {np.degrees(np.abs(error)[1:-1]).max(initial=0.0):.2f}'
    return (f'{worst(arm, known, zero):.3f} without {worst(arm, free, zero):.3f} '
            f'{"kept" if kept else "dropped"} {off}')


def worst(arm: Arm, model: GravityModel, zero: FloatArray) -> float:
    """Return the RMS error of the worst joint in N·m over the whole joint range."""
    q = poses(arm)
    left = model.predict(q - zero) - gravity_torque(arm, q)
    return float(np.sqrt((left ** 2).mean(axis=0)).max())


if __name__ == '__main__':
    sys.exit(main())
