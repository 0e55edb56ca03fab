"""Summary of the campaign: shares, counts and a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bench.campaign.score import Score, score
from bench.cases.cases import Case
from bench.shared.stored import table
import numpy as np

# Required results of the diagnosis: shares, and the ratio of held-out errors.
NAMED, COVERED, ERROR, OPEN = 0.95, (0.90, 0.98), 1.2, 0.90


@dataclass(frozen=True)
class Task:
    """One recording to diagnose, at `rate` Hz."""

    case: Case
    seed: int
    rate: float

    @property
    def file(self) -> str:
        return f'{self.case.arm}.{self.case.name}.{self.seed}.{self.rate:g}.json'


Result = tuple[Task, dict[str, Any]]


@dataclass(frozen=True)
class Scored:
    """One recording's score, and its held-out error relative to a fit with the true effects."""

    task: Task
    score: Score
    error: float | None
    seconds: float
    peak_mb: float


def scored(results: Sequence[Result]) -> list[Scored]:
    """Return the score of every result."""
    return [Scored(task, score(task.case, result['diagnosis'], result['joints']),
                   error_ratio(result), result['seconds'], result['peak_mb'])
            for task, result in results]


def error_ratio(result: dict[str, Any]) -> float | None:
    """Return the worst joint's held-out error relative to a fit with the true effects."""
    if 'floor' not in result:
        return None
    after = result['diagnosis']['joints']
    return max(after[name]['rmse_after'] / floor for name, floor in result['floor'].items())


def summary(results: Sequence[Result]) -> dict[str, Any]:
    """Return shares and counts over all recordings, and of every case on every arm."""
    rows = scored(results)
    groups: dict[str, list[Scored]] = {}
    for row in rows:
        groups.setdefault(f'{row.task.case.arm} {row.task.case.name}', []).append(row)
    return {'all': totals(rows), 'cases': {name: totals(group)
                                           for name, group in groups.items()}}


def totals(rows: Sequence[Scored]) -> dict[str, Any]:
    """Return shares and counts of a group of recordings; None for a share of nothing."""
    solvable = [row for row in rows if not row.task.case.untestable]
    unsolvable = [row for row in rows if row.task.case.untestable]
    intervals = [i.covers for row in rows for i in row.score.intervals]
    errors = [row.error for row in rows if row.error is not None]
    return {
        'recordings': len(rows), 'right': share(row.score.right for row in rows),
        'solvable': len(solvable),
        'named': share(all(row.score.named) for row in solvable),
        'named_truths': share(n for row in solvable for n in row.score.named),
        'with_false': share(bool(row.score.false) for row in rows),
        'intervals': len(intervals), 'covered': share(intervals),
        'error_ratio_median': float(np.median(errors)) if errors else None,
        'error_ratio_max': max(errors) if errors else None,
        'with_error': len(errors),
        'error_within': share(e <= ERROR for e in errors),
        'open_cases': len(unsolvable),
        'open_said': share(row.score.right for row in unsolvable),
        'seconds_median': float(np.median([row.seconds for row in rows])) if rows else None,
        'seconds_max': max((row.seconds for row in rows), default=None),
        'peak_mb': max((row.peak_mb for row in rows), default=None),
        'false': [f'seed {row.task.seed}: {text}' for row in rows for text in row.score.false],
        'missed': [f'seed {row.task.seed}: {truth.effect}:{_joint(truth.joint)}'
                   for row in solvable
                   for truth, named in zip(row.task.case.truths, row.score.named) if not named],
    }


def share(values: Any) -> float | None:
    """Return the share of true values, None for no values."""
    values = list(values)
    return sum(values) / len(values) if values else None


def markdown(results: Sequence[Result]) -> str:
    """Return the summary as Markdown: the requirements first, then each case."""
    outcome = summary(results)
    every = outcome['all']
    required = (
        ('true effect, or one ambiguous with it, on the right joint, at least '
         f'{NAMED:.0%}', 'named', 'solvable', 'recordings'),
        (f'truth inside the 95 % interval, {COVERED[0]:.0%} to {COVERED[1]:.0%}', 'covered',
         'intervals', 'intervals'),
        (f'held-out error within {ERROR} times that of a fit with the true effects',
         'error_within', 'with_error', 'recordings'),
        (f'untestable reported as such, at least {OPEN:.0%}', 'open_said',
         'open_cases', 'recordings'),
        ('any false finding', 'with_false', 'recordings', 'recordings'))
    return '\n'.join([
        table(('required', 'reached', 'of'), (
            (what, _percent(every[reached]), f'{every[count]} {unit}')
            for what, reached, count, unit in required)), '',
        f'Time of a diagnosis: median {_number(every["seconds_median"])} s, at most '
        f'{_number(every["seconds_max"])} s; peak memory {_number(every["peak_mb"])} MB.', '',
        table(('case', 'right', 'named', 'with a false finding', 'intervals that cover',
               'error ratio', 'missed', 'false findings'), (
            (name, *(_percent(one[share]) for share in (
                'right', 'named_truths', 'with_false', 'covered')),
             _span(one['error_ratio_median'], one['error_ratio_max']), _some(one['missed']),
             _some(one['false'])) for name, one in outcome['cases'].items())), ''])


def _percent(value: float | None) -> str:
    return '' if value is None else f'{100 * value:.0f} %'


def _span(median: float | None, maximum: float | None) -> str:
    return '' if maximum is None else f'{_number(median)}, at most {_number(maximum)}'


def _number(value: float | None) -> str:
    return '' if value is None else f'{value:.3g}'


def _some(texts: Sequence[str], limit: int = 3) -> str:
    return '; '.join(texts[:limit]) + (
        f'; and {len(texts) - limit} more' if len(texts) > limit else '')


def _joint(joint: int | None) -> str:
    return 'arm' if joint is None else str(joint + 1)
