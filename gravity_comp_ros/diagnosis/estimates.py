"""Coefficients of effects with 95 % intervals, and tests of whether they are zero."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.diagnosis.candidates import AnyTrial, Candidate
from gravity_comp_ros.diagnosis.evidence import covariance, Fit, largest_group_share
from gravity_comp_ros.diagnosis.findings import Estimate
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np
from scipy import special

_ALPHA = 0.05
# Share of a column's sum of squares in one group (an end stop that one run has reached) above
# which a jackknife over these groups is not used.
_ONE_GROUP = 0.9
# Number of speed classes of a jackknife.
_SPEEDS = 5


def estimates(fits: Fits, chosen: Sequence[Candidate], motion: Motion, candidate: Candidate,
              half: FloatArray) -> dict[str, Estimate]:
    """
    Return the coefficients of a chosen effect by their symbols.

    :param half: result of `half_widths` for its joint.
    """
    joint = candidate.joint_index
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


def every_interval_covers_zero(sizes: Mapping[str, Estimate]) -> bool:
    """Return whether every interval covers 0, widened for their number (Bonferroni)."""
    wider = special.ndtri(1.0 - 0.5 * _ALPHA / max(len(sizes), 1)) / special.ndtri(0.975)
    return all(abs(one.value) <= wider * 0.5 * (one.ci95[1] - one.ci95[0])
               for one in sizes.values())


def jointly_insignificant(fits: Fits, chosen: Sequence[Candidate], candidate: Candidate) -> bool:
    """
    Return whether the coefficients of a chosen effect do not differ from 0 jointly.

    It is Hotelling's test with the covariance over blocks. Coefficients of collinear columns can
    be insignificant one by one and significant together.
    """
    joint = candidate.joint_index
    groups = fits.rows[joint].group_of_rows(np.arange(fits.blocks.count))
    fit = fits.fit(joint, chosen)
    here = np.isin(fit.columns, candidate.columns)
    k, b = int(here.sum()), fits.blocks.count
    if k >= b:
        return True
    values = fit.all_data[here]
    variance = _covariance(fits, chosen, joint, fit, groups)[np.ix_(here, here)]
    t2 = float(values @ lstsq(variance, values, rcond=1e-10))
    return bool(special.fdtrc(k, b - k, t2 * (b - k) / (k * (b - 1))) >= _ALPHA)


def p_of_size(fits: Fits, chosen: Sequence[AnyTrial], candidate: AnyTrial) -> float:
    """
    Return the p-value of the single coefficient of a chosen effect, by jackknife over blocks.

    It is 1 if the jackknife over runs (or stretches of few runs) is not significant, unless one
    of these has nearly all of the excitation. Blocks of one motion can agree on a coefficient
    that another motion does not confirm.
    """
    rows, fit = fits.rows[candidate.joint_index], fits.fit(candidate.joint_index, chosen)
    places = rows.group_of_rows(fits.blocks.clusters)
    spread_out = float(largest_group_share(rows, candidate.columns, places)[0]) < _ONE_GROUP
    if spread_out and _p_of_first(fits, chosen, candidate, fit, places) >= _ALPHA:
        return 1.0
    blocks = rows.group_of_rows(np.arange(fits.blocks.count))
    return _p_of_first(fits, chosen, candidate, fit, blocks)


def _p_of_first(fits: Fits, chosen: Sequence[AnyTrial], candidate: AnyTrial, fit: Fit,
                groups: IntArray) -> float:
    """Return the p-value of an effect's first coefficient by the jackknife over groups."""
    here = int(np.flatnonzero(np.isin(fit.columns, candidate.columns))[0])
    variance = float(_covariance(fits, chosen, candidate.joint_index, fit, groups)[here, here])
    t = abs(float(fit.all_data[here])) / max(np.sqrt(max(variance, 0.0)), 1e-300)
    return float(2.0 * special.stdtr(max(int(groups.max()), 2), -t))


def half_widths(fits: Fits, chosen: Sequence[Candidate], joint: int,
                motion: Motion) -> FloatArray:
    """
    Return the half-widths (P,) of the 95 % intervals of a joint's scaled coefficients.

    Each is the largest of jackknives over blocks, runs (or stretches of few runs) and speed
    classes. If the law of an effect is only approximate, its coefficient depends on poses and
    speeds, and blocks of one motion agree on a biased value.
    """
    fit, speed = fits.fit(joint, chosen), np.abs(motion.samples.qd[:, joint])
    rows, widths = fits.rows[joint], []
    for groups in (rows.group_of_rows(np.arange(fits.blocks.count)),
                   rows.group_of_rows(fits.blocks.clusters), _by_speed(speed)[rows.row_of]):
        variance = np.diag(_covariance(fits, chosen, joint, fit, groups))
        quantile = special.stdtrit(max(int(groups.max()), 2), 0.975)
        spread_out = largest_group_share(rows, fit.columns, groups) < _ONE_GROUP
        widths.append(quantile * np.sqrt(np.maximum(variance, 0.0)) * spread_out)
    return np.asarray(np.max(widths, axis=0))


def _by_speed(speed: FloatArray) -> IntArray:
    """Return the speed class of each sample (M,); classes have equally many samples."""
    groups = np.empty(len(speed), dtype=np.int64)
    groups[np.argsort(speed, kind='stable')] = np.arange(len(speed)) * _SPEEDS // len(speed)
    return groups


def _covariance(fits: Fits, chosen: Sequence[AnyTrial], joint: int, fit: Fit,
                groups: IntArray) -> FloatArray:
    return covariance(fits.rows[joint], fit, len(fits.shared(chosen)),
                      fits.prior(joint, chosen), groups)
