"""
Gravity of arms on walls and ceilings with an upright robot description.

    python -m bench.estimator.mounted --seeds 11,12

Each arm is recorded for 60 s of slow motion, with and without friction, its base rotated by each
angle about a random horizontal axis. A line has the RMS error of the worst joint in N·m over the
whole joint range, the angle that `fit` reports and whether it kept the description, the largest
standard deviation that it reports, and the relative error of the nominal arm's inertial torque
with these moments. Seeds 1 and 2 were used for tuning.
"""

from __future__ import annotations

import argparse
import sys

from bench.estimator.fast_motion import poses, recorded, TEST_ARMS, worst
from bench.planning.scenes import ARMS, known_axes
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import fit_model
from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.nominal_arm import nominal_parameters
from gravity_comp_ros.models.kinematic.rigid_body import regressor
from gravity_comp_ros.simulation.arms import (
    Arm, gravity_torque, inverse_dynamics, with_base_tilt)
import numpy as np

_SECONDS = 60.0
# Number of poses for the error of the inertial torque.
_POSES = 200


def main() -> int:
    """Print a line for each recording."""
    parser = argparse.ArgumentParser(description='Arms on walls and ceilings.')
    parser.add_argument('--arms', default=TEST_ARMS)
    parser.add_argument('--seeds', default='11,12')
    parser.add_argument('--turns', default='0,3,20,45,90,135,180', help='tilts in degrees')
    parser.add_argument('--speed', type=float, default=0.12, help='maximum, rad/s')
    parser.add_argument('--band', type=float, default=0.1, help='Hz')
    args = parser.parse_args()
    for name in args.arms.split(','):
        upright = ARMS[name]()
        for seed in map(int, args.seeds.split(',')):
            for angle in map(int, args.turns.split(',')):
                azimuth = np.random.default_rng([seed, angle]).uniform(0.0, 2.0 * np.pi)
                arm = tilted(upright, np.radians(angle), azimuth)
                for friction in (0.0, 0.01):
                    samples = slow_motion(arm, seed, friction, args.speed, args.band)
                    print(name, seed, angle, friction, measured(arm, upright, samples), flush=True)
    return 0


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


def slow_motion(arm: Arm, seed: int, friction: float, speed: float = 0.12,
                band: float = 0.1) -> JointSamples:
    """Return motion of all joints over 0.6 of their range, up to `speed` rad/s and `band` Hz."""
    return recorded(arm, seed, speed, band, friction, _SECONDS, minimum_friction=0.0)


def measured(arm: Arm, upright: Arm, samples: JointSamples) -> str:
    """Return a text of the errors of a fit with the upright description."""
    axes = known_axes(upright)
    result = fit_model(Recording(samples), FitOptions(geometry=axes))[0]
    angle = np.degrees(result.report.base_tilt)
    std = max(result.report.std_over_poses.values(), default=0.0)
    return (f'{worst(arm, result.model):.3f} tilt {angle:.1f} '
            f'{"kept" if result.model.geometry is not None else "dropped"} '
            f'std {std:.2f} inertia {inertia_error(arm, result.model):.2f}')


def inertia_error(arm: Arm, model: GravityModel) -> float:
    """Return the relative RMS error of the inertial torque of the nominal arm."""
    if model.geometry is None or model.chain is None:
        return float('nan')
    q = poses(arm)[:_POSES]
    qdd = np.random.default_rng(1).uniform(-1.0, 1.0, q.shape)
    at_rest = np.zeros_like(q)
    true = inverse_dynamics(arm, q, at_rest, qdd) - gravity_torque(arm, q)
    predicted = regressor(model.geometry, q, at_rest, qdd) @ nominal_parameters(
        model.geometry, model.chain.moments / STANDARD_GRAVITY)
    scale = np.maximum((true ** 2).mean(axis=0), 1e-12)
    return float(np.sqrt((((predicted - true) ** 2).mean(axis=0) / scale).mean()))


if __name__ == '__main__':
    sys.exit(main())
