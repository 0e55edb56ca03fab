"""
Vertical of arms on floors and ceilings with an upright robot description.

    python -m bench.vertical --seeds 3,4,5

Nine arms are tilted by angles near 0 and 180 degrees and recorded in slow motion: 60 s in
0.6 of the joint ranges, and 15 s in 0.2 of them, half of the recordings with friction. The number
of verticals that are inverted is printed for each length, and for floors and ceilings. Seeds 0, 1
and 2 were used for tuning.
"""

from __future__ import annotations

import argparse
import sys

from bench.planning.scenes import ARMS
from bench.shared.fast_arms import moved
from bench.shared.serial_arms import geometry_of
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.vertical import with_estimated_vertical
from gravity_comp_ros.simulation.arms import Arm, with_base_tilt
import numpy as np

_ANGLES = {'floor': (0.0, 1.0, 5.0, 20.0), 'ceiling': (175.0, 179.0, 180.0)}
# Duration in s, and the share of the joint ranges.
_MOTIONS = ((60.0, 0.6), (15.0, 0.2))
# Maximum speed in rad/s, and band in Hz.
_SPEED, _BAND = 0.12, 0.1


def main() -> int:
    """Print the number of inverted verticals."""
    parser = argparse.ArgumentParser(description='Arms on floors and ceilings.')
    parser.add_argument('--arms', default=','.join(ARMS))
    parser.add_argument('--seeds', default='3,4,5')
    args = parser.parse_args()
    seeds = [int(seed) for seed in args.seeds.split(',')]
    for mounting, angles in _ANGLES.items():
        for seconds, share in _MOTIONS:
            inverted = [is_inverted(name, angle, seed, seconds, share)
                        for name in args.arms.split(',') for angle in angles for seed in seeds]
            print(f'{mounting}, {seconds:.0f} s: {sum(inverted)} of {len(inverted)} inverted',
                  flush=True)
    return 0


def is_inverted(name: str, angle: float, seed: int, seconds: float, share: float) -> bool:
    """Return whether the estimated vertical of a recording is nearer to the opposite one."""
    upright = ARMS[name]()
    rng = np.random.default_rng([seed, int(10 * angle)])
    arm = tilted(upright, np.radians(angle), rng.uniform(0.0, 2.0 * np.pi))
    axes = geometry_of(upright)
    samples = moved(arm, seed, _SPEED, _BAND, 0.01 * rng.integers(2), seconds, 0.0, share)
    estimated = with_estimated_vertical(axes, Problem.of(samples))
    vertical = (estimated.rotations[0] @ axes.rotations[0].T)[2]
    return bool(vertical @ arm.model.gravity.linear > 0.0)


def tilted(arm: Arm, angle: float, azimuth: float) -> Arm:
    """Return the arm with its base rotated by an angle about a horizontal axis, both in rad."""
    axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]],
                      [-axis[1], axis[0], 0.0]])
    rotation = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    # R = Ry(pitch) Rx(roll) gives the same vertical; a rotation about it does not change gravity.
    up = rotation[2]
    roll = float(np.arctan2(up[1], up[2]))
    pitch = float(np.arctan2(-up[0], np.hypot(up[1], up[2])))
    return with_base_tilt(arm, roll, pitch)


if __name__ == '__main__':
    sys.exit(main())
