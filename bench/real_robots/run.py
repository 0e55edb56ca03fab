"""
Loops on descriptions of real robots: fit, diagnose, add, judged on a third run.

Run from the root of the repository:

    python -m bench.real_robots.run results/ --seeds 400 --jobs 2
    python -m bench.real_robots.run results/ --seeds 300-304 --described --oracle
    python -m bench.real_robots.run results/ --seeds 400 --arms panda,ur5

A case is an arm of `arms.SOURCES` and a seed (`cases`).

Seeds 373 to 399 are for judging: no tuning on them, and no look at their single cases before the
code is final. Seeds 328 to 372 were judged, those from 300 to 327 looked at: they and those from
400 on are for tuning.
Friction with two levels in seeds up to 306 had a force that jumped at a reversal. Results of seeds
up to 320 are of an earlier draw: the bristles of load friction and of asymmetric friction counted
as visible, so that some of these effects had no load, or no constant beyond gravity.

A case is right if
- every hidden effect is named, alone or as one of several alternatives;
- no effect is established or likely that is absent; friction of any kind on a joint with LuGre
  friction, viscous friction of a joint with a hidden friction law, and dynamics are present;
- the rms residual on the unseen run is at most 1.5 times the noise on every joint. Least squares
  with the exact laws and dynamics has 0.98 to 1.03 times the noise on all joints of seed 400;
- the static torque (gravity and added static effects) over the box of trained poses is within
  0.5 % of the arm's largest gravity torque (rms, worst joint). A friction law that is larger in
  one direction allows any constant between zero and half the difference.

The table also counts the cases right if with LuGre friction 1.25 times the error of an oracle is
enough (--oracle), and the published 95 % intervals that cover the true coefficient. The oracle is
a fit of this package that is given the description and the true effects; its error is as bad as
the laws of the library, so this count is lenient.
"""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
import sys
from typing import Any

from bench.real_robots.arms import descriptions, PACKAGE, SOURCES
from bench.real_robots.cases import case
from bench.real_robots.product import loop, oracle
from bench.real_robots.score import error_ratios, score, table
from bench.shared.runner import names, Result, run, seeds
import gravity_comp_ros as gc
from gravity_comp_ros.data.samples import FloatArray
import numpy as np


def options(parser: ArgumentParser) -> None:
    arms_and_seeds(parser)
    parser.add_argument('--described', action='store_true', help='fit with the description')
    parser.add_argument('--oracle', action='store_true', help='also fit the true effects')


def arms_and_seeds(parser: ArgumentParser) -> None:
    """Add the options of each bench on descriptions of real robots."""
    parser.add_argument('--seeds', type=seeds, default='400', help='e.g. 400 or 300-304,401')
    parser.add_argument('--arms', type=arm_names, default=','.join(SOURCES),
                        help='(default: %(default)s)')


def arm_names(text: str) -> list[str]:
    """Return the arms of a list such as panda,ur5."""
    if descriptions() is None:
        raise ArgumentTypeError(f'descriptions are missing: pip install {PACKAGE}')
    if unknown := sorted(set(names(text)) - set(SOURCES)):
        raise ArgumentTypeError(f'no arm {", ".join(unknown)}; there are {", ".join(SOURCES)}')
    return names(text)


def each(args: Namespace, *more: Any) -> dict[str, tuple[Any, ...]]:
    """Return the arguments of each arm and seed, with further ones, by the name of the case."""
    suffix = ''.join(f'.{value:d}' for value in more)
    return {f'{arm}.{seed}{suffix}': (arm, seed, *more)
            for seed in args.seeds for arm in args.arms}


def judged(arm: str, seed: int, described: bool, with_oracle: bool) -> Result:
    """Return the result of a case."""
    one = case(arm, seed)
    about = {'case': one.name, 'described': described, 'lugre': bool(one.friction),
             'hidden': [f'{h.effect}:{h.joint + 1}' for h in one.hidden],
             'visible': one.visible}
    try:
        outcome = loop(one, described)
    except gc.GravityCompError as problem:
        reason = (f'failed: {problem}',)
        return {**about, 'why': reason, 'why_oracle': reason}
    best, no_oracle = None, ''
    if with_oracle:
        try:
            best = oracle(one)
        except gc.GravityCompError as problem:
            no_oracle = str(problem)
    result = score(one, outcome.findings, outcome.torque, outcome.static, best)
    return {**about, **result.to_json(), 'added': outcome.added,
            'before': float(error_ratios(one, outcome.before).max()),
            'seconds': outcome.seconds, 'refused': outcome.refused,
            'findings': outcome.findings, 'no_oracle': no_oracle}


def rms(torque: FloatArray, truth: FloatArray, largest: float) -> float:
    """Return the rms error of torques (K, N), worst joint, in percent of the largest torque."""
    error = torque - truth
    return 100.0 * float(np.sqrt((error ** 2).mean(axis=0)).max() / largest)


if __name__ == '__main__':
    sys.exit(run(__doc__, options, lambda args: each(args, args.described, args.oracle), judged,
                 lambda result: '; '.join(result['why']) or 'right', table))
