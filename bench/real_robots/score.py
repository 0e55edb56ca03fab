"""
Score of one case: what was named, and how well torque and static torque are predicted; table.

The score is a function of the case and of the estimator's output alone: findings as printed by
`diagnose --json`, torque on the unseen run, static torque in the poses of the trained box.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from bench.real_robots.cases import Case
from bench.real_robots.laws import FRICTION
from bench.shared.findings import Coverage, coverage, false_findings, Finding
from bench.shared.runner import Result, table_of
from gravity_comp_ros.data.samples import FloatArray
import numpy as np


@dataclass(frozen=True)
class Bounds:
    """
    Bounds of a right case.

    `error` is that of the rms residual of every joint on the unseen run, in noise levels of that
    joint. `of_oracle` is an alternative bound of joints with LuGre friction, relative to the
    oracle's error of that joint, 0 for none. `static` is that of the rms error of the static
    torque, worst joint, as a share of the arm's largest gravity torque.
    """

    error: float = 1.5
    of_oracle: float = 0.0
    static: float = 0.005


STRICT, LUGRE = Bounds(), Bounds(of_oracle=1.25)


@dataclass(frozen=True)
class Score:
    """
    Score of one case.

    `missed` and `false` are effects as `NAME:NUMBER`, joints from 1; `tied` are the truths that
    are named only as one of several alternatives. `error` and `static` are figures of the worst
    joints, as in `Bounds`; `errors` are those of all joints, `oracle` those of the oracle. `why`
    is empty for a right case (bounds `STRICT`), `why_oracle` for one within the bounds `LUGRE`.
    """

    missed: tuple[str, ...]
    false: tuple[str, ...]
    tied: tuple[str, ...]
    error: float
    errors: tuple[float, ...]
    static: float
    oracle: tuple[float, ...] | None
    intervals: tuple[Coverage, ...]
    why: tuple[str, ...]
    why_oracle: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the score as JSON."""
        return asdict(self)


def score(one: Case, findings: Sequence[Mapping[str, Any]], torque: FloatArray,
          static: FloatArray, oracle: FloatArray | None = None) -> Score:
    """
    Return the score of an estimator on a case.

    :param findings: entries `findings` of `diagnose --json`; joints by name.
    :param torque: predicted torque (M, N) in N·m on the unseen run, joints in the case's order.
    :param static: predicted torque at rest (K, N) in N·m in `one.poses`.
    :param oracle: torque (M, N) of a fit that was given the true effects.
    """
    parsed = [Finding.of(entry, one.joints) for entry in findings]
    missed, tied = [], []
    for truth in one.hidden:
        answers = [f for f in parsed if f.names(truth.answers)]
        if not any(f.accepted for f in answers):
            (tied if answers else missed).append(f'{truth.effect}:{truth.joint + 1}')
    present = {pair for truth in one.hidden for pair in (*truth.answers, *truth.allowed)}
    present |= {(name, f.joint) for f in one.friction for name in FRICTION}
    false = false_findings(parsed, present)
    errors = error_ratios(one, torque)
    of_oracle = None if oracle is None else error_ratios(one, oracle)
    reference = np.zeros_like(errors) if of_oracle is None else one.has_lugre * of_oracle
    low, high = one.static(one.poses)
    off = np.maximum(np.maximum(low - static, static - high), 0.0) / one.largest
    rms = np.sqrt((off ** 2).mean(axis=0))
    names = (*(f'missed {name}' for name in missed), *(f'false {name}' for name in false))
    why = [(*names, *_beyond(bounds, errors, reference, float(rms.max())))
           for bounds in (STRICT, LUGRE)]
    return Score(tuple(missed), false, tuple(tied), float(errors.max()),
                 tuple(map(float, errors)), float(rms.max()),
                 None if of_oracle is None else tuple(map(float, of_oracle)),
                 coverage(parsed, one.known), *why)


def error_ratios(one: Case, torque: FloatArray) -> FloatArray:
    """Return the rms residual (N,) of a torque (M, N) on the unseen run, in noise levels."""
    residual = one.unseen.tau - torque
    return np.asarray(np.sqrt((residual ** 2).mean(axis=0)) / one.noise)


def _beyond(bounds: Bounds, errors: FloatArray, oracle: FloatArray, static: float) -> list[str]:
    """Return the figures outside the bounds as text; NaN is outside."""
    within = errors <= np.maximum(bounds.error, bounds.of_oracle * oracle)
    out = [] if within.all() else [f'error {errors[~within].max():.2f} x noise']
    return out if static <= bounds.static else [*out, f'static {100 * static:.2f} %']


_HEAD = ('case', 'friction', 'hidden', 'error', 'before', 'oracle', 'static %', 's', 'result')


def table(results: Sequence[Result]) -> str:
    """Return the cases as Markdown, and the totals, one sentence a line."""
    return '\n'.join([table_of(_HEAD, map(_row, results)), '', *_totals(results)])


def _totals(results: Sequence[Result]) -> list[str]:
    done = [r for r in results if 'error' in r]
    right, of_oracle = (sum(not r[key] for r in results) for key in ('why', 'why_oracle'))
    count = {key: sum(len(r[key]) for r in done)
             for key in ('hidden', 'missed', 'tied', 'false', 'intervals')}
    covered = sum(i['covers'] for r in done for i in r['intervals'])
    figures = (('Error on the unseen run, worst joint, x noise', [r['error'] for r in done]),
               ('Static torque, worst joint, %', [100 * r['static'] for r in done]),
               ('Processor time, s', [sum(r['seconds'].values()) for r in done]))
    return [f'{right} of {len(results)} right; with 1.25 x oracle on joints with LuGre friction: '
            f'{of_oracle}. {len(results) - len(done)} failed.',
            f'Of {count["hidden"]} effects {count["tied"]} tied, {count["missed"]} missed; '
            f'{count["false"]} false findings; {sum(bool(r["refused"]) for r in done)} additions '
            f'refused.',
            f'{covered} of {count["intervals"]} published 95 % intervals cover.',
            *(f'{title}: {np.median(values):.2f} in the median, {max(values):.2f} at most.'
              for title, values in figures if values)]


def _row(r: Result) -> list[str]:
    why = '; '.join(r.get('why', ()))
    if 'error' not in r:
        return [str(r.get('case', 'not run')), *[''] * 7, why]
    return [r['case'], 'LuGre' if r['lugre'] else '', ' '.join(r['hidden']),
            f'{r["error"]:.2f}', f'{r["before"]:.2f}',
            '' if r.get('oracle') is None else f'{max(r["oracle"]):.2f}',
            f'{100 * r["static"]:.2f}', f'{sum(r["seconds"].values()):.1f}',
            why + (f' (refused: {r["refused"]})' if r['refused'] else '') or 'right']
