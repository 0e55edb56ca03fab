"""
How much each threshold of a diagnosis matters: the campaign at half and at twice its value.

Run from the root of the repository:

    python -m bench.campaign.sensitivity --seeds 1 --jobs 2
    python -m bench.campaign.sensitivity --drawn 20 --arms six_axis
    python -m bench.campaign.sensitivity --judging --first 9 --arms six_axis,any_six

Recordings are those of the named cases, of cases whose effects are drawn at random and may be
small, or of judging cases (friction in every joint, up to three effects beside it, degraded
recordings), shortened to 60 s at 25 Hz a run. The evidence of each is gathered once; effects are
chosen and judged from it for every value. These cases have served to choose some of the
thresholds: the table shows what depends on a value, not how good the diagnosis is. The last column
counts recordings that are diagnosed otherwise than with the thresholds as they are.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from multiprocessing import get_context
import os
import sys

from bench.campaign.judging import judging_case, KINDS
from bench.campaign.results import Task
from bench.campaign.score import score
from bench.cases.case_list import cases, ROLES
from bench.cases.cases import Case, recordings
from bench.cases.drawn import drawn_case
from gravity_comp_ros.diagnosis.diagnose import conclude, gather
from gravity_comp_ros.diagnosis.options import DiagnosisOptions

RATE, SECONDS = 25.0, 60.0
AS_IT_IS = 'as it is'
# Effects that need recordings of their full length, and motion that shows less.
_SLOW = ('drift', 'warming', 'one_way')
Counts = dict[str, 'Count']


@dataclass(frozen=True)
class Count:
    """Effects that are there and were named, intervals that cover, and recordings with a fault."""

    recordings: int = 0
    right: int = 0
    false: int = 0
    truths: int = 0
    named: int = 0
    intervals: int = 0
    covering: int = 0
    other: int = 0

    def __add__(self, other: Count) -> Count:
        return Count(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def __str__(self) -> str:
        return (f'{self.right} of {self.recordings} | {self.named} of {self.truths} | '
                f'{self.false} | {self.covering} of {self.intervals} | {self.other}')


def variants() -> Iterator[tuple[str, DiagnosisOptions]]:
    """Yield the options as they are, and with each threshold at half and at twice its value."""
    usual = DiagnosisOptions()
    yield AS_IT_IS, usual
    for group in ('selection', 'verdict'):
        options = getattr(usual, group)
        for name in (f.name for f in fields(options)):
            value = getattr(options, name)
            for changed in (_half(value), _double(value)):
                other = replace(options, **{name: changed})
                yield f'`{name}` {value:g} → {changed:g}', replace(usual, **{group: other})


def _half(value: float) -> float:
    return value // 2 if isinstance(value, int) else 0.5 * value


def _double(value: float) -> float:
    """Return twice a value; of a share that has no double, half of what is missing to 1."""
    return 0.5 * (1.0 + value) if 0.5 < value < 1.0 else 2 * value


def counted(task: Task) -> Counts:
    """Return what each variant makes of one recording."""
    samples = recordings(replace(task.case, duration=SECONDS), task.seed, task.rate)
    evidence = gather(samples)
    counts, usual = {}, None
    for name, options in variants():
        diagnosis = conclude(evidence, options)
        said = {(f.effect, f.joint, f.verdict) for f in diagnosis.findings}
        usual = said if usual is None else usual
        found = score(task.case, diagnosis.to_json(), samples.names)
        counts[name] = Count(1, int(found.right), int(bool(found.false)), len(found.named),
                             sum(found.named), len(found.intervals),
                             sum(i.covers for i in found.intervals), int(said != usual))
    return counts


def table(totals: Counts) -> str:
    """Return the sums as a table in Markdown."""
    head = ('| threshold | recordings judged rightly | effects named | recordings with a false '
            'finding | intervals that cover | recordings diagnosed otherwise |\n'
            '|---|---|---|---|---|---|')
    return '\n'.join([head, *(f'| {name} | {count} |' for name, count in totals.items())])


def chosen(args: argparse.Namespace, arm: str, seed: int) -> Sequence[Case]:
    """Return the cases of an arm that were asked for."""
    if args.judging:
        return [judging_case(arm, kind, seed) for kind in KINDS if kind not in _SLOW]
    return [drawn_case(arm, number) for number in range(args.drawn)] or cases(arm)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--arms', default=','.join(ROLES))
    parser.add_argument('--drawn', type=int, default=0, metavar='N', help='N drawn cases an arm')
    parser.add_argument('--judging', action='store_true', help='judging cases of motion both ways')
    parser.add_argument('--seeds', type=int, default=1)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--jobs', type=int, default=1)
    args = parser.parse_args()
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    totals: Counts = {name: Count() for name, _ in variants()}
    tasks = [Task(case, seed, RATE) for seed in range(args.first, args.first + args.seeds)
             for arm in args.arms.split(',') for case in chosen(args, arm, seed)]
    with get_context('spawn').Pool(args.jobs, maxtasksperchild=8) as pool:
        for number, counts in enumerate(pool.imap_unordered(counted, tasks), start=1):
            totals = {name: totals[name] + counts[name] for name in totals}
            print(f'{number}/{len(tasks)}', file=sys.stderr, flush=True)
    print(table(totals))
    return 0


if __name__ == '__main__':
    sys.exit(main())
