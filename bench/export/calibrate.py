"""
Torque constants from a known weight: fourteen real arms whose constants are off by up to 30 %.

    python3 -m bench.export.calibrate [--seeds 600 601] [--com]

The arm of `bench.real_robots` moves slowly without and with a weight of 5 to 15 % of its mass on
the last link (at least 0.2 kg), with inertia, noise of 0.1 to 0.2 % of the scale of each joint,
and in two of three cases LuGre friction on every joint. Its efforts are torques divided by
factors of 0.7 to 1.3. The centre of mass is unknown to the calibration, or known with --com. The
motion fills a box of 0.7 to 1.2 rad, or with --wide 90 % of the joint limits, at most ±2 rad.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
import sys

from bench.real_robots.arms import arm_of, SOURCES, urdf
from bench.real_robots.cases import generator, Setting
from gravity_comp_ros.calibration.known_weight import (
    calibrate, CalibrationOptions, Weight, WeightCalibration)
from gravity_comp_ros.data.gate import GateOptions, slow_samples
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.simulation.arms import Payload, with_payload
import numpy as np


# As the command: slow motion, at the rate of the recording.
RATE = GateOptions(rate_hz=None)


def trial(name: str, seed: int, is_known: bool,
          is_wide: bool, is_same: bool) -> tuple[WeightCalibration, FloatArray]:
    """Return the calibration of one case, and the true N·m per unit (N,)."""
    rng = generator(name, seed, 11)
    text, joints = urdf(name), SOURCES[name].joints
    arm = arm_of(text)
    setting = Setting.drawn(arm, rng)
    if is_wide:
        setting = replace(setting, low=0.9 * np.maximum(arm.lower, -2.2),
                          high=0.9 * np.minimum(arm.upper, 2.2))
    total = sum(body.mass for body in arm.model.inertias)
    centre = rng.uniform(-0.06, 0.06, 3)
    mass = max(0.2, rng.uniform(0.05, 0.15) * total)
    friction = setting.friction()
    constants = rng.uniform(0.7, 1.3, arm.n_joints)
    parts = []
    for one in (arm, with_payload(arm, Payload(mass, tuple(centre)))):
        run = setting.run(friction, arm=one)
        parts.append(slow_samples(JointSamples.single_run(
            joints, run.t, run.q, run.qd, run.tau / constants), RATE).samples)
    described = described_arm(text, joints)
    weight = Weight(f'{joints[-1]}_link', float(mass), tuple(centre) if is_known else None)
    try:
        return calibrate(*parts, described, weight,
                         CalibrationOptions(same_offset=is_same)), constants
    except DataError:  # no joint
        return WeightCalibration({}, {}, {}, {}, {}), constants


def main() -> int:
    """Run all cases and print a line for each."""
    parser = argparse.ArgumentParser(description='Torque constants from a known weight.')
    parser.add_argument('--seeds', type=int, nargs='+', default=[600])
    parser.add_argument('--arms', nargs='+', default=list(SOURCES))
    parser.add_argument('--wide', action='store_true', help='motion over most of the range')
    parser.add_argument('--same-zero', action='store_true', help='one offset for both')
    parser.add_argument('--com', action='store_true', help='the centre of mass is known')
    args = parser.parse_args()
    errors, covered, n_left_out, n_joints = [], [], 0, 0
    for seed in args.seeds:
        for name in args.arms:
            result, constants = trial(name, seed, args.com, args.wide, args.same_zero)
            joints = SOURCES[name].joints
            texts = []
            for joint, true in zip(joints, constants):
                n_joints += 1
                if joint not in result.scales:
                    n_left_out += 1
                    texts.append('-')
                    continue
                scale = result.scales[joint]
                errors.append(100.0 * (scale.value / true - 1.0))
                covered.append(scale.ci95[0] <= true <= scale.ci95[1])
                half = 50.0 * np.ptp(scale.ci95) / true
                texts.append(f'{errors[-1]:+.2f} ± {half:.2f}')
            print(f'{name:10} {seed}  error in %: {", ".join(texts)}')
    size = np.abs(errors)
    print(f'{len(errors)} of {n_joints} joints calibrated; error: median {np.median(size):.2f} %, '
          f'95 % below {np.quantile(size, 0.95):.2f} %, worst {size.max():.2f} %; '
          f'{100 * np.mean(size < 2.0):.1f} % within 2 %; true value in the interval: '
          f'{100 * np.mean(covered):.1f} %')
    return 0


if __name__ == '__main__':
    sys.exit(main())
