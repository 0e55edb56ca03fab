"""Table of the campaign: counts over all recordings, and over those of each case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bench.campaign.score import Score, score
from bench.cases.cases import Case
from bench.shared.stored import table
import numpy as np

# Required held-out error relative to a fit with the true effects.
ERROR = 1.25
_HEAD = ('case', 'effects named', 'untestable reported', 'with a false finding',
         'intervals that cover', f'error within {ERROR} x that of the true effects, worst',
         'time in s: median, worst', 'missed, false')


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


def markdown(results: Sequence[Result]) -> str:
    """Return the counts as Markdown: all recordings first, then each case on each arm."""
    groups: dict[str, list[Result]] = {'all': list(results)}
    for task, result in results:
        groups.setdefault(f'{task.case.arm} {task.case.name}', []).append((task, result))
    return table(_HEAD, ((name, *_counts(group)) for name, group in groups.items())) + '\n'


def _counts(group: Sequence[Result]) -> tuple[str, ...]:
    judged = [(task, score(task.case, result['diagnosis'], result['joints']))
              for task, result in group]
    solvable = [one for task, one in judged if not task.case.untestable]
    unsolvable = [one for task, one in judged if task.case.untestable]
    errors = [error_ratio(result) for _, result in group if 'floor' in result]
    seconds = [result['seconds'] for _, result in group]
    return (_share([all(one.named) for one in solvable]),
            _share([one.right for one in unsolvable]),
            _share([bool(one.false) for _, one in judged]),
            _share([interval.covers for _, one in judged for interval in one.intervals]),
            _share([error <= ERROR for error in errors]) + f', {max(errors, default=np.nan):.2f}',
            f'{np.median(seconds):.0f}, {max(seconds):.0f}',
            '; '.join(text for task, one in judged for text in _wrong(task, one)))


def error_ratio(result: dict[str, Any]) -> float:
    """Return the worst joint's held-out error relative to a fit with the true effects."""
    after = result['diagnosis']['joints']
    return max(after[name]['rmse_after'] / floor for name, floor in result['floor'].items())


def _share(values: Sequence[bool]) -> str:
    return f'{sum(values)} of {len(values)}'


def _wrong(task: Task, one: Score) -> list[str]:
    missed = [] if task.case.untestable else [
        f'missed {truth.effect}' for truth, named in zip(task.case.truths, one.named) if not named]
    return [f'seed {task.seed}: {text}' for text in (*missed, *one.false)]
