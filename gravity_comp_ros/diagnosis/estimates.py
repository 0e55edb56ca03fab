"""How large an effect is: its coefficients with 95 % intervals, and whether it may be nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.diagnosis.candidates import AnyTrial, Candidate
from gravity_comp_ros.diagnosis.evidence import covariance, Fit, largest_part
from gravity_comp_ros.diagnosis.findings import Estimate
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np
from scipy import special

_DOUBT = 0.05
# Where one place has more than this of an effect (a stop that one run has reached), what the
# others say without it is nothing.
_ONE_PLACE = 0.9
# Classes of speed that an interval is drawn from.
_SPEEDS = 5


def estimates(fits: Fits, chosen: Sequence[Candidate], motion: Motion, candidate: Candidate,
              half: FloatArray) -> dict[str, Estimate]:
    """
    Return the coefficients of a chosen effect by their symbols.

    :param half: what `half_widths` returns of its joint.
    """
    joint = candidate.place
    gram, fit = fits.rows[joint], fits.fit(joint, chosen)
    here = np.flatnonzero(np.isin(fit.columns, candidate.columns))
    scale = gram.scale[fit.columns[here]]
    values, half = fit.all_data[here] / scale, half[here] / scale
    symbols = candidate.effect.coefficients_of(motion, joint, candidate.setting)
    names = [symbols[k].symbol if k < len(symbols) else f'{symbols[-1].symbol}_{k}'
             for k in range(len(values))]
    return {name: Estimate(float(v), symbols[min(k, len(symbols) - 1)].unit,
                           (float(v - h), float(v + h)))
            for k, (name, v, h) in enumerate(zip(names, values, half))}


def each_may_be_nothing(sizes: Mapping[str, Estimate]) -> bool:
    """
    Return whether every coefficient may be 0.

    Intervals are widened for their number (Bonferroni): of twenty, one misses 0 by chance.
    """
    wider = special.ndtri(1.0 - 0.5 * _DOUBT / max(len(sizes), 1)) / special.ndtri(0.975)
    return all(abs(one.value) <= wider * 0.5 * (one.ci95[1] - one.ci95[0])
               for one in sizes.values())


def all_may_be_nothing(fits: Fits, chosen: Sequence[Candidate], candidate: Candidate) -> bool:
    """
    Return whether the coefficients of a chosen effect may all be 0 at once.

    Where several can stand for each other, each may be 0 and yet not all: that is Hotelling's
    test, with the spread over blocks.
    """
    joint = candidate.place
    groups = fits.rows[joint].group_of_rows(np.arange(fits.blocks.count))
    fit = fits.fit(joint, chosen)
    here = np.isin(fit.columns, candidate.columns)
    k, b = int(here.sum()), fits.blocks.count
    if k >= b:
        return True
    values = fit.all_data[here]
    spread = _covariance(fits, chosen, joint, fit, groups)[np.ix_(here, here)]
    t2 = float(values @ lstsq(spread, values, rcond=1e-10))
    return bool(special.fdtrc(k, b - k, t2 * (b - k) / (k * (b - 1))) >= _DOUBT)


def p_of_size(fits: Fits, chosen: Sequence[AnyTrial], candidate: AnyTrial) -> float:
    """
    Return the p-value of a chosen effect's one coefficient, by the jackknife over blocks.

    It is 1 where the jackknife over places leaves 0 in the interval, unless one place has nearly
    all of the effect: blocks of one motion may agree on what is nothing elsewhere.
    """
    rows, fit = fits.rows[candidate.place], fits.fit(candidate.place, chosen)
    places = rows.group_of_rows(fits.blocks.clusters)
    told = float(largest_part(rows, candidate.columns, places)[0]) < _ONE_PLACE
    if told and _p_of_first(fits, chosen, candidate, fit, places) >= _DOUBT:
        return 1.0
    blocks = rows.group_of_rows(np.arange(fits.blocks.count))
    return _p_of_first(fits, chosen, candidate, fit, blocks)


def _p_of_first(fits: Fits, chosen: Sequence[AnyTrial], candidate: AnyTrial, fit: Fit,
                groups: IntArray) -> float:
    """Return the p-value of an effect's first coefficient by the jackknife over groups."""
    here = int(np.flatnonzero(np.isin(fit.columns, candidate.columns))[0])
    spread = float(_covariance(fits, chosen, candidate.place, fit, groups)[here, here])
    t = abs(float(fit.all_data[here])) / max(np.sqrt(max(spread, 0.0)), 1e-300)
    return float(2.0 * special.stdtr(max(int(groups.max()), 2), -t))


def half_widths(fits: Fits, chosen: Sequence[Candidate], joint: int,
                motion: Motion) -> FloatArray:
    """
    Return half of the 95 % intervals (P,) of a joint's fit.

    They are those of the scaled coefficients: of jackknives over blocks, places and speeds, the
    widest. Where the law of an effect is not quite that of the arm, its size depends on where and
    how fast the arm moved; blocks of one motion agree on the wrong value.
    """
    fit, speed = fits.fit(joint, chosen), np.abs(motion.samples.qd[:, joint])
    rows, widths = fits.rows[joint], []
    for groups in (rows.group_of_rows(np.arange(fits.blocks.count)),
                   rows.group_of_rows(fits.blocks.clusters), _by_speed(speed)[rows.row_of]):
        spread = _covariance(fits, chosen, joint, fit, groups)
        wide = special.stdtrit(max(int(groups.max()), 2), 0.975)
        told = largest_part(rows, fit.columns, groups) < _ONE_PLACE
        widths.append(wide * np.sqrt(np.maximum(np.diag(spread), 0.0)) * told)
    return np.asarray(np.max(widths, axis=0))


def _by_speed(speed: FloatArray) -> IntArray:
    """Return which of some equally large classes of speed each sample (M,) is in."""
    groups = np.empty(len(speed), dtype=np.int64)
    groups[np.argsort(speed, kind='stable')] = np.arange(len(speed)) * _SPEEDS // len(speed)
    return groups


def _covariance(fits: Fits, chosen: Sequence[AnyTrial], joint: int, fit: Fit,
                groups: IntArray) -> FloatArray:
    return covariance(fits.rows[joint], fit, len(fits.shared(chosen)),
                      fits.prior(joint, chosen), groups)
