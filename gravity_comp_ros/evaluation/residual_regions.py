"""
Where a model fails: the conditions under which a joint's residual is larger than elsewhere.

The samples are cut along one condition at a time (own position, direction, speed, load, time,
run, inside or outside the trained range), and the parts whose mean square error stands out are
named in words. Neighbours in time are alike, so a part must stand out by more than the spread
of stretches of it, not of its samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
import numpy as np

# A part is named if its RMSE is at least this many times the RMSE of the rest.
_STANDS_OUT = 1.5
_MIN_SAMPLES = 10
_MIN_STRETCHES = 2
_MOST = 3
_STILL = 1e-3


@dataclass(frozen=True)
class Place:
    """
    A condition under which the residual is large, for one joint.

    `axis` names the condition, `low` and `high` its bounds where it has any; `rmse` and `bias`
    are in N·m, `ratio` is to the RMSE of all other samples; `words` says it in a sentence.
    """

    axis: str
    low: float | None
    high: float | None
    n: int
    rmse: float
    bias: float
    ratio: float
    words: str


def find_places(samples: JointSamples, predicted: FloatArray, outside: BoolArray,
                joint: int) -> list[Place]:
    """Return the worst places of one joint, the worst first; none if it fails evenly."""
    residual = samples.tau[:, joint] - predicted[:, joint]
    found = []
    for axis, low, high, text, mask in _parts(samples, predicted, outside, joint):
        place = _judge(samples, residual, mask, axis, low, high, text)
        if place is not None:
            found.append(place)
    best: dict[str, Place] = {}
    for place in sorted(found, key=lambda p: -p.ratio):
        best.setdefault(place.axis, place)
    return list(best.values())[:_MOST]


def _judge(samples: JointSamples, residual: FloatArray, mask: BoolArray, axis: str,
           low: float | None, high: float | None, text: str) -> Place | None:
    n, rest = int(mask.sum()), ~mask
    if n < _MIN_SAMPLES or rest.sum() < _MIN_SAMPLES:
        return None
    here, there = (float(np.sqrt((residual[m] ** 2).mean())) for m in (mask, rest))
    ratio = here / max(there, 1e-12)
    if ratio < _STANDS_OUT or not _repeats(samples, residual, mask, there):
        return None
    words = f'{text}: RMSE {here:.3g} N·m, {ratio:.1f} times elsewhere ({n} samples)'
    return Place(axis, low, high, n, here, float(residual[mask].mean()), ratio, words)


def _repeats(samples: JointSamples, residual: FloatArray, mask: BoolArray,
             elsewhere: float) -> bool:
    """Return whether most visits to a part, not one lucky stretch, are worse than elsewhere."""
    border = np.flatnonzero(np.diff(mask.astype(int)) | np.diff(samples.runs)) + 1
    stretches = [part for part in np.split(np.arange(len(mask)), border) if mask[part[0]]]
    if len(stretches) < _MIN_STRETCHES:
        return int(mask.sum()) >= 3 * _MIN_SAMPLES
    worse = [np.sqrt((residual[part] ** 2).mean()) > elsewhere for part in stretches]
    return bool(np.mean(worse) > 0.6)


def _parts(samples: JointSamples, predicted: FloatArray, outside: BoolArray, joint: int
           ) -> Iterator[tuple[str, float | None, float | None, str, BoolArray]]:
    q, qd = samples.q[:, joint], samples.qd[:, joint]
    yield from _bins('position', q, 'at {:.2f} to {:.2f} rad', 6)
    yield ('direction', None, None, 'moving up', qd > _STILL)
    yield ('direction', None, None, 'moving down', qd < -_STILL)
    yield ('direction', None, None, 'standing still', np.abs(qd) <= _STILL)
    yield from _bins('speed', np.abs(qd), 'at a speed of {:.3f} to {:.3f} rad/s', 4)
    yield from _bins('load', predicted[:, joint], 'at a load of {:.1f} to {:.1f} N·m', 4)
    yield ('trained range', None, None, 'outside the trained range', outside)
    if samples.n_runs > 1:
        for number, label in enumerate(samples.run_labels):
            yield ('run', float(number), None, f'in run {label}', samples.runs == number)
    else:
        yield from _bins('time', samples.t - samples.t[0], 'from {:.1f} to {:.1f} s', 5)


def _bins(axis: str, values: FloatArray, text: str, count: int
          ) -> Iterator[tuple[str, float | None, float | None, str, BoolArray]]:
    """Cut at even distances, so that a part is a place and not a share of the samples."""
    if np.ptp(values) <= 0.0:
        return
    edges = np.linspace(values.min(), values.max(), count + 1)
    place = np.clip(np.searchsorted(edges, values, side='right') - 1, 0, count - 1)
    for k in range(count):
        low, high = float(edges[k]), float(edges[k + 1])
        yield axis, low, high, text.format(low, high), place == k
