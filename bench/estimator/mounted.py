"""
Gravity of arms on walls and ceilings whose description stands upright.

    python -m bench.estimator.mounted --seeds 11,12

Each arm is recorded for 60 s of slow motion, with and without friction, its base turned by each
angle about a horizontal line drawn at random. A line has the RMS error of the worst joint in N·m
over the whole joint range, the angle that `fit` reports and whether it kept the description, the
largest standard deviation that it reports, and what the nominal arm with these moments lacks of
the torque of motion, as a share of it. Seeds 1 and 2 were looked at while the search for the
vertical was made.
"""

from __future__ import annotations

import argparse
import sys

from bench.estimator.fast_motion import JUDGED, poses, worst
from bench.planning.scenes import ARMS, known_axes
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import fit_model
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.effects.arm_dynamics import first_moments
from gravity_comp_ros.estimation.fit import FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.nominal_arm import nominal_parameters
from gravity_comp_ros.models.kinematic.rigid_body import regressor
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import (
    Arm, gravity_torque, inverse_dynamics, with_base_tilt)
from gravity_comp_ros.simulation.disturbances.friction import Friction
from gravity_comp_ros.simulation.disturbances.lugre import LuGre
from gravity_comp_ros.simulation.noise import NoiseOptions
from gravity_comp_ros.simulation.synthesise import synthesise, SynthesisOptions
import numpy as np

_SECONDS, _RATE, _NOISE = 60.0, 50.0, 0.1
_POSES = 200


def main() -> int:
    """Print a line for each recording."""
    parser = argparse.ArgumentParser(description='Arms on walls and ceilings.')
    parser.add_argument('--arms', default=JUDGED)
    parser.add_argument('--seeds', default='11,12')
    parser.add_argument('--turns', default='0,3,20,45,90,135,180', help='degrees')
    parser.add_argument('--speed', type=float, default=0.12, help='largest, rad/s')
    parser.add_argument('--band', type=float, default=0.1, help='Hz')
    args = parser.parse_args()
    for name in args.arms.split(','):
        upright = ARMS[name]()
        for seed in map(int, args.seeds.split(',')):
            for turn in map(int, args.turns.split(',')):
                about = np.random.default_rng([seed, turn]).uniform(0.0, 2.0 * np.pi)
                arm = turned(upright, np.radians(turn), about)
                for friction in (0.0, 0.01):
                    samples = recorded(arm, seed, friction, args.speed, args.band)
                    print(name, seed, turn, friction, measured(arm, upright, samples), flush=True)
    return 0


def turned(arm: Arm, angle: float, about: float) -> Arm:
    """Return the arm with its base turned by an angle about a horizontal line, both in rad."""
    axis = np.array([np.cos(about), np.sin(about), 0.0])
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]],
                      [-axis[1], axis[0], 0.0]])
    rotation = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    # R = Ry(pitch) Rx(roll) leaves the vertical where any turn about it would.
    up = rotation[2]
    roll = float(np.arctan2(up[1], up[2]))
    pitch = float(np.arctan2(-up[0], np.hypot(up[1], up[2])))
    return with_base_tilt(arm, roll, pitch)


def recorded(arm: Arm, seed: int, friction: float, speed: float = 0.12,
             band: float = 0.1) -> JointSamples:
    """Return motion of all joints in 0.6 of their range, up to `speed` rad/s and `band` Hz."""
    motion = motions.multisine(0.6 * arm.lower, 0.6 * arm.upper, np.full(arm.n_joints, speed),
                               seed, motions.MultisineOptions(band, _SECONDS), _SECONDS, _RATE)
    levels = friction * np.ptp(gravity_torque(arm, poses(arm)), axis=0)
    rubs = tuple(Friction(n, LuGre(float(level), float(level))) for n, level in enumerate(levels)
                 if friction)
    return synthesise(arm, motion,
                      SynthesisOptions(NoiseOptions(0.0, _NOISE), seed, disturbances=rubs))


def measured(arm: Arm, upright: Arm, samples: JointSamples) -> str:
    """Return the errors of a fit with the description that stands upright, in words."""
    axes = known_axes(upright)
    result = fit_model(Recording(samples), FitOptions(geometry=axes))[0]
    angle = np.degrees(result.report.base_tilt)
    doubt = max(result.report.std_over_poses.values(), default=0.0)
    return (f'{worst(arm, result.model):.3f} turned {angle:.1f} '
            f'{"kept" if result.model.geometry is not None else "dropped"} '
            f'doubt {doubt:.2f} motion {motion_error(arm, result.model):.2f}')


def motion_error(arm: Arm, model: GravityModel) -> float:
    """Return what the nominal arm lacks of the torque of motion, as a share of it, RMS."""
    if model.geometry is None:
        return float('nan')
    q = poses(arm)[:_POSES]
    qdd = np.random.default_rng(1).uniform(-1.0, 1.0, q.shape)
    still = np.zeros_like(q)
    true = inverse_dynamics(arm, q, still, qdd) - gravity_torque(arm, q)
    found = regressor(model.geometry, q, still, qdd) @ nominal_parameters(
        model.geometry, first_moments(model, model.geometry))
    scale = np.maximum((true ** 2).mean(axis=0), 1e-12)
    return float(np.sqrt((((found - true) ** 2).mean(axis=0) / scale).mean()))


if __name__ == '__main__':
    sys.exit(main())
