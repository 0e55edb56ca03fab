"""
Sensitivity of the diagnosis to its thresholds: the campaign at half and twice each value.

Run from the root of the repository:

    python -m bench.campaign.sensitivity --seeds 1 --jobs 2
    python -m bench.campaign.sensitivity --drawn 20 --arms six_axis
    python -m bench.campaign.sensitivity --judging --first 9 --arms six_axis,any_six

Recordings are those of the named cases, of cases with random effects, which may be small, or of
test cases (`--judging`: friction in every joint, up to three further effects, degraded
recordings), shortened to 60 s at 25 Hz for each run. The evidence of a recording is computed once;
effects are selected and assessed from it for every value. Some thresholds were tuned on these
cases: the table shows the influence of a value, not the accuracy of the diagnosis. The last column
counts recordings whose diagnosis differs from that with unchanged thresholds.
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

# Sampling rate in Hz, and duration of a run in s.
RATE, SECONDS = 25.0, 60.0
UNCHANGED = 'unchanged'
# Kinds of cases that require the full duration, or whose motion excites fewer effects.
_EXCLUDED = ('drift', 'warming', 'one_way')
Counts = dict[str, 'Count']


@dataclass(frozen=True)
class Count:
    """
    Counts over recordings.

    `false` counts recordings with a false finding, `changed` those whose diagnosis differs from
    that with unchanged thresholds.
    """

    recordings: int = 0
    right: int = 0
    false: int = 0
    truths: int = 0
    named: int = 0
    intervals: int = 0
    covering: int = 0
    changed: int = 0

    def __add__(self, other: Count) -> Count:
        return Count(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def __str__(self) -> str:
        return (f'{self.right} of {self.recordings} | {self.named} of {self.truths} | '
                f'{self.false} | {self.covering} of {self.intervals} | {self.changed}')


def variants() -> Iterator[tuple[str, DiagnosisOptions]]:
    """Yield the default options, and those with each threshold at half and at twice its value."""
    default = DiagnosisOptions()
    yield UNCHANGED, default
    for group in ('selection', 'verdict'):
        options = getattr(default, group)
        for name in (f.name for f in fields(options)):
            value = getattr(options, name)
            for changed in (_half(value), _double(value)):
                yield f'`{name}` {value:g} → {changed:g}', replace(
                    default, **{group: replace(options, **{name: changed})})


def _half(value: float) -> float:
    return value // 2 if isinstance(value, int) else 0.5 * value


def _double(value: float) -> float:
    """Return twice a value; of a fraction above one half, the mean of it and 1."""
    return 0.5 * (1.0 + value) if 0.5 < value < 1.0 else 2 * value


def counted(task: Task) -> Counts:
    """Return the counts of each variant on one recording."""
    samples = recordings(replace(task.case, duration=SECONDS), task.seed, task.rate)
    evidence = gather(samples)
    counts, reference = {}, None
    for name, options in variants():
        diagnosis = conclude(evidence, options)
        findings = {(f.effect, f.joint, f.verdict) for f in diagnosis.findings}
        reference = findings if reference is None else reference
        result = score(task.case, diagnosis.to_json(), samples.names)
        counts[name] = Count(1, int(result.right), int(bool(result.false)), len(result.named),
                             sum(result.named), len(result.intervals),
                             sum(i.covers for i in result.intervals), int(findings != reference))
    return counts


def table(totals: Counts) -> str:
    """Return the sums as a table in Markdown."""
    head = ('| threshold | correct diagnoses | effects named | recordings with a false '
            'finding | intervals that cover | changed diagnoses |\n'
            '|---|---|---|---|---|---|')
    return '\n'.join([head, *(f'| {name} | {count} |' for name, count in totals.items())])


def chosen(args: argparse.Namespace, arm: str, seed: int) -> Sequence[Case]:
    """Return the requested cases of an arm."""
    if args.judging:
        return [judging_case(arm, kind, seed) for kind in KINDS if kind not in _EXCLUDED]
    return [drawn_case(arm, number) for number in range(args.drawn)] or cases(arm)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--arms', default=','.join(ROLES))
    parser.add_argument('--drawn', type=int, default=0, metavar='N',
                        help='N random cases of each arm')
    parser.add_argument('--judging', action='store_true',
                        help='test cases with motion in both directions')
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
