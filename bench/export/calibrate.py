"""
Torque constants from a known weight: fourteen real arms whose constants are off by up to 30 %.

    python3 -m bench.export.calibrate [--seeds 600-601] [--com]

The arm of `bench.real_robots` moves slowly without and with a weight of 5 to 15 % of its mass on
the last link (at least 0.2 kg), with inertia, noise of 0.1 to 0.2 % of the scale of each joint,
and in two of three cases LuGre friction on every joint. Its efforts are torques divided by
factors of 0.7 to 1.3. The centre of mass is unknown to the calibration, or known with --com. The
motion fills a box of 0.7 to 1.2 rad, or with --wide 90 % of the joint limits, at most ±2 rad.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import replace
import sys
from typing import Any

from bench.real_robots.arms import arm_of, SOURCES, urdf
from bench.real_robots.cases import generator, Setting
from bench.real_robots.run import arms_and_seeds, each
from bench.shared.runner import Result, run
from gravity_comp_ros.calibration.known_weight import (
    calibrate, CalibrationOptions, Weight)
from gravity_comp_ros.data.gate import GateOptions, slow_samples
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.simulation.arms import Payload, with_payload
import numpy as np

# As the command: slow motion, at the rate of the recording.
RATE = GateOptions(rate_hz=None)


def trial(name: str, seed: int, is_known: bool, is_wide: bool, is_same: bool) -> Result:
    """Return the errors in percent, and the coverage, of the calibrated joints of one case."""
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
    for held in (arm, with_payload(arm, Payload(mass, tuple(centre)))):
        one = setting.run(friction, arm=held)
        parts.append(slow_samples(JointSamples.single_run(
            joints, one.t, one.q, one.qd, one.tau / constants), RATE).samples)
    described = described_arm(text, joints)
    weight = Weight(f'{joints[-1]}_link', float(mass), tuple(centre) if is_known else None)
    try:
        scales = calibrate(*parts, described, weight,
                           CalibrationOptions(same_offset=is_same)).scales
    except DataError:  # no joint
        scales = {}
    found = [(scales[joint], true) for joint, true in zip(joints, constants) if joint in scales]
    return {'joints': len(joints),
            'errors': [100.0 * (scale.value / true - 1.0) for scale, true in found],
            'covers': [bool(scale.ci95[0] <= true <= scale.ci95[1]) for scale, true in found]}


def options(parser: ArgumentParser) -> None:
    arms_and_seeds(parser)
    parser.set_defaults(seeds=[600])
    parser.add_argument('--wide', action='store_true', help='motion over most of the range')
    parser.add_argument('--same-zero', action='store_true', help='one offset for both')
    parser.add_argument('--com', action='store_true', help='the centre of mass is known')


def cases(args: Namespace) -> dict[str, tuple[Any, ...]]:
    return each(args, args.com, args.wide, args.same_zero)


def totals(results: Sequence[Result]) -> str:
    size = np.abs([error for result in results for error in result['errors']])
    if not len(size):
        return 'no joint calibrated'
    covers = [covers for result in results for covers in result['covers']]
    return (f'{len(size)} of {sum(result["joints"] for result in results)} joints calibrated; '
            f'error: median {np.median(size):.2f} %, 95 % below {np.quantile(size, 0.95):.2f} %, '
            f'worst {size.max():.2f} %; {100 * np.mean(size < 2.0):.1f} % within 2 %; true value '
            f'in the interval: {100 * np.mean(covers):.1f} %')


if __name__ == '__main__':
    sys.exit(run(__doc__, options, cases, trial, lambda result: totals([result]), totals))
