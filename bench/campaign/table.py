"""The campaign's outcome in numbers, and as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bench.campaign.results import Task
from bench.campaign.score import Score, score
import numpy as np

# What the diagnosis has to reach.
NAMED, FALSE_ALARMS, COVERED, ERROR, OPEN = 0.95, 0.02, (0.90, 0.98), 1.2, 0.90

Result = tuple[Task, dict[str, Any]]


@dataclass(frozen=True)
class Judged:
    """One recording's score, and its held-out error over that of a fit that knew the truth."""

    task: Task
    score: Score
    error: float | None
    seconds: float
    peak_mb: float


def judged(results: Sequence[Result]) -> list[Judged]:
    """Return the score of every result."""
    return [Judged(task, score(task.case, result['diagnosis'], result['joints']),
                   error_ratio(result), result['seconds'], result['peak_mb'])
            for task, result in results]


def error_ratio(result: dict[str, Any]) -> float | None:
    """Return the worst joint's held-out error after diagnosis over the fit's that knew all."""
    if 'floor' not in result:
        return None
    after = result['diagnosis']['joints']
    return max(after[name]['rmse_after'] / floor for name, floor in result['floor'].items())


def summary(results: Sequence[Result]) -> dict[str, Any]:
    """Return shares and counts over all recordings, and of every case on every arm."""
    scored = judged(results)
    groups: dict[str, list[Judged]] = {}
    for one in scored:
        groups.setdefault(f'{one.task.case.arm} {one.task.case.name}', []).append(one)
    return {'all': totals(scored), 'cases': {name: totals(group)
                                             for name, group in groups.items()}}


def totals(scored: Sequence[Judged]) -> dict[str, Any]:
    """Return what a group of recordings amounts to; None where there is nothing to count."""
    solvable = [one for one in scored if one.task.case.verdict == 'found']
    empty = [one for one in scored if one.task.case.verdict == 'nothing']
    honest = [one for one in scored if one.task.case.verdict in ('unexplained', 'untestable')]
    intervals = [i.covers for one in scored for i in one.score.intervals]
    errors = [one.error for one in scored if one.error is not None]
    return {
        'recordings': len(scored), 'right': share(one.score.right for one in scored),
        'solvable': len(solvable),
        'named': share(all(one.score.named) for one in solvable),
        'named_truths': share(n for one in solvable for n in one.score.named),
        'with_false': share(bool(one.score.false) for one in scored),
        'nothing_missing': len(empty),
        'false_alarms': share(bool(one.score.false) for one in empty),
        'intervals': len(intervals), 'covered': share(intervals),
        'error_ratio_median': float(np.median(errors)) if errors else None,
        'error_ratio_max': max(errors) if errors else None,
        'with_error': len(errors),
        'error_within': share(e <= ERROR for e in errors),
        'open_cases': len(honest), 'open_said': share(one.score.right for one in honest),
        'seconds_median': float(np.median([one.seconds for one in scored])) if scored else None,
        'seconds_max': max((one.seconds for one in scored), default=None),
        'peak_mb': max((one.peak_mb for one in scored), default=None),
        'false': [f'seed {one.task.seed}: {text}' for one in scored for text in one.score.false],
        'missed': [f'seed {one.task.seed}: {truth.effect}:{_where(truth.joint)}'
                   for one in solvable
                   for truth, named in zip(one.task.case.truths, one.score.named) if not named],
    }


def share(values: Any) -> float | None:
    """Return the share of true values, None if there are none at all."""
    values = list(values)
    return sum(values) / len(values) if values else None


def markdown(results: Sequence[Result]) -> str:
    """Return the outcome as text: what is asked for first, then case by case."""
    found = summary(results)
    every = found['all']
    lines = ['| asked for | reached | of |', '|---|---|---|',
             f'| true effect or its tie on the right joint, at least {NAMED:.0%} | '
             f'{_percent(every["named"])} | {every["solvable"]} recordings |',
             f'| false alarms where nothing is missing, at most {FALSE_ALARMS:.0%} | '
             f'{_percent(every["false_alarms"])} | {every["nothing_missing"]} recordings |',
             f'| truth inside the 95 % interval, {COVERED[0]:.0%} to {COVERED[1]:.0%} | '
             f'{_percent(every["covered"])} | {every["intervals"]} intervals |',
             f'| held-out error within {ERROR} of a fit that knew the truth | '
             f'{_percent(every["error_within"])} | {every["with_error"]} recordings |',
             f'| unexplained or untestable said where right, at least {OPEN:.0%} | '
             f'{_percent(every["open_said"])} | {every["open_cases"]} recordings |',
             f'| any false finding beside the true ones | {_percent(every["with_false"])} | '
             f'{every["recordings"]} recordings |', '',
             f'Time of a diagnosis: median {_number(every["seconds_median"])} s, at most '
             f'{_number(every["seconds_max"])} s; peak memory {_number(every["peak_mb"])} MB.',
             '', '| case | right | named | false | covered | error ratio | missed | false ones |',
             '|---|---|---|---|---|---|---|---|']
    for name, row in found['cases'].items():
        lines.append(
            f'| {name} | {_percent(row["right"])} | {_percent(row["named_truths"])} | '
            f'{_percent(row["with_false"])} | {_percent(row["covered"])} | '
            f'{_span(row["error_ratio_median"], row["error_ratio_max"])} | '
            f'{_some(row["missed"])} | {_some(row["false"])} |')
    return '\n'.join(lines) + '\n'


def _percent(value: float | None) -> str:
    return '' if value is None else f'{100 * value:.0f} %'


def _span(middle: float | None, most: float | None) -> str:
    return '' if most is None else f'{_number(middle)}, at most {_number(most)}'


def _number(value: float | None) -> str:
    return '' if value is None else f'{value:.3g}'


def _some(texts: Sequence[str], most: int = 3) -> str:
    shown = '; '.join(texts[:most])
    return shown + (f'; and {len(texts) - most} more' if len(texts) > most else '')


def _where(joint: int | None) -> str:
    return 'arm' if joint is None else str(joint + 1)
