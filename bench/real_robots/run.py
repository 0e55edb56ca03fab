"""
Loops on descriptions of real robots: fit, diagnose, add, judged on a third run.

Run from the root of the repository:

    python -m bench.real_robots.run results/ --seeds 400 --jobs 2
    python -m bench.real_robots.run results/ --seeds 300-304 --described --oracle
    python -m bench.real_robots.run results/ --seeds 400 --arms panda,ur5

A case is an arm of `arms.SOURCES` and a seed (`cases`). The folder stores the result of every case
and the table. A stopped run resumes; results of older code are computed again unless --keep is
given.

Seeds 357 to 399 are for judging: no tuning on them, and no look at their single cases before the
code is final. Seeds 328 to 356 were judged, those from 300 to 327 looked at: they and those from
400 on are for tuning, and so are the judged seeds 344, 347 to 349 and 353, which showed faults.
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

import argparse
from pathlib import Path
import sys
from typing import Any

from bench.real_robots.arms import descriptions, PACKAGE, SOURCES
from bench.real_robots.cases import case
from bench.real_robots.product import loop, oracle
from bench.real_robots.score import error_ratios, score, table
from bench.shared.stored import fingerprint, load, run
import gravity_comp_ros as gc
from gravity_comp_ros.atomic import write_atomically

Task = tuple[str, int, bool, bool, Path]
"""Arm, seed, whether with description and oracle, folder."""


def main() -> int:
    """Judge the cases without a result, and print the table of all requested ones."""
    args = parser().parse_args()
    folder, code = Path(args.folder), fingerprint(Path(__file__).parent)
    folder.mkdir(parents=True, exist_ok=True)
    tasks: list[Task] = [(arm, seed, args.described, args.oracle, folder)
                         for seed in args.seeds for arm in args.arms]
    missing = []
    for task in tasks:
        stored = load(result_file(task), None if args.keep else code)
        if not stored or args.oracle and 'no_oracle' not in stored:
            missing.append(task)
    print(f'{len(tasks)} cases, {len(tasks) - len(missing)} done before', flush=True)
    run(judged, missing, result_file, code, args.jobs,
        lambda result: f'{result["case"]} {"; ".join(result["why"]) or "right"}')
    text = table([load(result_file(task)) for task in tasks])
    name = f'table{"-described" if args.described else ""}.md'
    write_atomically(folder / name, text.encode(), gc.GravityCompError)
    print(text)
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    out = argparse.ArgumentParser(description='Loops on descriptions of real robots.')
    out.add_argument('folder', help='folder of results')
    out.add_argument('--seeds', type=seeds, default='400', help='e.g. 400 or 300-304,401')
    out.add_argument('--arms', type=arm_names, default=','.join(SOURCES),
                     help=f'(default: {",".join(SOURCES)})')
    out.add_argument('--described', action='store_true', help='fit with the description')
    out.add_argument('--oracle', action='store_true', help='also fit the true effects')
    out.add_argument('--jobs', type=int, default=1, help='processes (default: 1)')
    out.add_argument('--keep', action='store_true', help='keep results of older code')
    return out


def arm_names(text: str) -> list[str]:
    """Return the arms of a list such as panda,ur5."""
    names = text.split(',')
    if descriptions() is None:
        raise argparse.ArgumentTypeError(f'descriptions are missing: pip install {PACKAGE}')
    unknown = sorted(set(names) - set(SOURCES))
    if unknown:
        raise argparse.ArgumentTypeError(f'no arm {", ".join(unknown)}; there are '
                                         f'{", ".join(SOURCES)}')
    return names


def seeds(text: str) -> list[int]:
    """Return the seeds of a list such as 400 or 300-304,401."""
    out: list[int] = []
    for part in text.split(','):
        first, _, last = part.partition('-')
        out += range(int(first), int(last or first) + 1)
    return out


def judged(task: Task) -> tuple[Task, dict[str, Any]]:
    """Return the result of a case."""
    arm, seed, described, with_oracle, _ = task
    one = case(arm, seed)
    about = {'case': one.name, 'described': described, 'lugre': bool(one.friction),
             'hidden': [f'{h.effect}:{h.joint + 1}' for h in one.hidden],
             'visible': one.visible}
    try:
        outcome = loop(one, described)
    except gc.GravityCompError as problem:
        reason = (f'failed: {problem}',)
        return task, {**about, 'why': reason, 'why_oracle': reason, 'no_oracle': 'failed'}
    best, tried = None, {}
    if with_oracle:
        try:
            best, tried = oracle(one), {'no_oracle': ''}
        except gc.GravityCompError as problem:
            tried = {'no_oracle': str(problem)}
    result = score(one, outcome.findings, outcome.torque, outcome.static, best)
    return task, {**about, **result.to_json(), 'added': outcome.added,
                  'before': float(error_ratios(one, outcome.before).max()),
                  'seconds': outcome.seconds, 'refused': outcome.refused,
                  'findings': outcome.findings, **tried}


def result_file(task: Task) -> Path:
    """Return the file of a result."""
    arm, seed, described, _, folder = task
    of = '.described' if described else ''
    return folder / f'{arm}.{seed}{of}.json'


if __name__ == '__main__':
    sys.exit(main())
