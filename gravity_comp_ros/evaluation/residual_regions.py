"""
Regions of a large residual: conditions under which a joint's error is larger than elsewhere.

The samples are divided along one condition at a time (own position, direction, speed, load, time,
run, inside or outside the trained range). Regions with a large mean square error are reported.
Residuals are autocorrelated, so a region must be worse in most of its visits, not only on average
over its samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
import numpy as np

# Minimum ratio of a region's RMSE to that of the other samples.
_MIN_RATIO = 1.5
_MIN_SAMPLES = 10
_MIN_VISITS = 2
_MAX_REGIONS = 3
# Maximum speed, in rad/s, of a joint at rest.
_MAX_REST_SPEED = 1e-3


@dataclass(frozen=True)
class ResidualRegion:
    """
    A condition under which the residual of one joint is large.

    `axis` is the condition, `low` and `high` its bounds where it has any; `rmse` and `bias` are
    in N·m, `ratio` is to the RMSE of all other samples; `words` is a description.
    """

    axis: str
    low: float | None
    high: float | None
    n: int
    rmse: float
    bias: float
    ratio: float
    words: str


# A candidate region: condition, low, high, description, mask (M,).
_Candidate = tuple[str, float | None, float | None, str, BoolArray]


def find_regions(samples: JointSamples, predicted: FloatArray, outside: BoolArray,
                 joint: int) -> list[ResidualRegion]:
    """Return the worst regions of one joint, the worst first; none if its error is even."""
    residual = samples.tau[:, joint] - predicted[:, joint]
    regions = [region for candidate in _candidates(samples, predicted, outside, joint)
               if (region := _region(samples, residual, candidate)) is not None]
    best: dict[str, ResidualRegion] = {}
    for region in sorted(regions, key=lambda each: -each.ratio):
        best.setdefault(region.axis, region)
    return list(best.values())[:_MAX_REGIONS]


def _region(samples: JointSamples, residual: FloatArray,
            candidate: _Candidate) -> ResidualRegion | None:
    """Return a candidate with its errors, None if they are not larger than elsewhere."""
    axis, low, high, text, mask = candidate
    n = int(mask.sum())
    if n < _MIN_SAMPLES or len(mask) - n < _MIN_SAMPLES:
        return None
    rmse, elsewhere = (float(np.sqrt((residual[m] ** 2).mean())) for m in (mask, ~mask))
    ratio = rmse / max(elsewhere, 1e-12)
    if ratio < _MIN_RATIO or not _is_repeated(samples, residual, mask, elsewhere):
        return None
    sentence = f'{text}: RMSE {rmse:.3g} N·m, {ratio:.1f} times elsewhere ({n} samples)'
    return ResidualRegion(axis, low, high, n, rmse, float(residual[mask].mean()), ratio, sentence)


def _is_repeated(samples: JointSamples, residual: FloatArray, mask: BoolArray,
                 elsewhere: float) -> bool:
    """Return whether most visits to a region, not a single one, are worse than elsewhere."""
    border = np.flatnonzero(np.diff(mask.astype(int)) | np.diff(samples.runs)) + 1
    visits = [part for part in np.split(np.arange(len(mask)), border) if mask[part[0]]]
    if len(visits) < _MIN_VISITS:
        return int(mask.sum()) >= 3 * _MIN_SAMPLES
    worse = [np.sqrt((residual[part] ** 2).mean()) > elsewhere for part in visits]
    return bool(np.mean(worse) > 0.6)


def _candidates(samples: JointSamples, predicted: FloatArray, outside: BoolArray,
                joint: int) -> Iterator[_Candidate]:
    q, qd = samples.q[:, joint], samples.qd[:, joint]
    yield from _bins('position', q, 'at {:.2f} to {:.2f} rad', 6)
    yield ('direction', None, None, 'moving up', qd > _MAX_REST_SPEED)
    yield ('direction', None, None, 'moving down', qd < -_MAX_REST_SPEED)
    yield ('direction', None, None, 'standing still', np.abs(qd) <= _MAX_REST_SPEED)
    yield from _bins('speed', np.abs(qd), 'at a speed of {:.3f} to {:.3f} rad/s', 4)
    yield from _bins('load', predicted[:, joint], 'at a load of {:.1f} to {:.1f} N·m', 4)
    yield ('trained range', None, None, 'outside the trained range', outside)
    if samples.n_runs > 1:
        for number, label in enumerate(samples.run_labels):
            yield ('run', float(number), None, f'in run {label}', samples.runs == number)
    else:
        yield from _bins('time', samples.t - samples.t[0], 'from {:.1f} to {:.1f} s', 5)


def _bins(axis: str, values: FloatArray, text: str, count: int) -> Iterator[_Candidate]:
    """Yield bins of equal width, not of equal sample numbers."""
    if np.ptp(values) <= 0.0:
        return
    edges = np.linspace(values.min(), values.max(), count + 1)
    number = np.clip(np.searchsorted(edges, values, side='right') - 1, 0, count - 1)
    for k in range(count):
        low, high = float(edges[k]), float(edges[k + 1])
        yield axis, low, high, text.format(low, high), number == k
