"""Comparison of a model with measurements: errors by joint, and regions of large residual."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.runs import numbers_in
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.display import change, Displayable, percent, TextTable
from gravity_comp_ros.effects.predict import predict_torque, static_std
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np


@dataclass(frozen=True)
class ComparisonOptions:
    """
    Constants of the regions of large residual, and of the drift between models.

    - `min_ratio`: of a region's RMSE to that of the other samples.
    - `min_samples`: inside and outside; of a region that is visited once three times as many.
    - `max_regions`: number that is reported; `bins`: parts of each range.
    - `rest_speed`, rad/s: maximum speed of a joint at rest.
    - `significance`: size of a drift in standard deviations of both models.

    :raises OptionError: if a number is not positive.
    """

    min_ratio: float = 1.5
    min_samples: int = 10
    max_regions: int = 3
    bins: int = 6
    rest_speed: float = 1e-3
    significance: float = 3.0

    def __post_init__(self) -> None:
        check_positive(self, 'comparison')


COMPARISON = ComparisonOptions()


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
    """
    Return the worst regions of one joint, the worst first; none if its error is even.

    The samples are divided along one condition at a time (own position, direction, speed, load,
    time, run, inside or outside the trained range). Residuals are autocorrelated, so a region must
    be worse in most of its visits, not only on average over its samples.
    """
    residual = samples.tau[:, joint] - predicted[:, joint]
    worst: dict[str, ResidualRegion] = {}
    for axis, low, high, text, mask in _candidates(samples, predicted, outside, joint):
        n = int(mask.sum())
        if min(n, len(mask) - n) < COMPARISON.min_samples:
            continue
        rmse, elsewhere = (float(np.sqrt((residual[m] ** 2).mean())) for m in (mask, ~mask))
        ratio = rmse / max(elsewhere, 1e-12)
        is_worst = axis not in worst or ratio > worst[axis].ratio
        if (ratio >= COMPARISON.min_ratio and is_worst
                and _is_repeated(samples, residual, mask, elsewhere)):
            worst[axis] = ResidualRegion(
                axis, low, high, n, rmse, float(residual[mask].mean()), ratio,
                f'{text}: RMSE {rmse:.3g} N·m, {ratio:.1f} times elsewhere ({n} samples)')
    return sorted(worst.values(), key=lambda each: -each.ratio)[:COMPARISON.max_regions]


def _is_repeated(samples: JointSamples, residual: FloatArray, mask: BoolArray,
                 elsewhere: float) -> bool:
    """Return whether most visits to a region, not a single one, are worse than elsewhere."""
    border = np.flatnonzero(np.diff(mask.astype(int)) | np.diff(samples.runs)) + 1
    visits = [part for part in np.split(np.arange(len(mask)), border) if mask[part[0]]]
    if len(visits) < 2:
        return int(mask.sum()) >= 3 * COMPARISON.min_samples
    return bool(np.median([(residual[part] ** 2).mean() for part in visits]) > elsewhere ** 2)


def _candidates(samples: JointSamples, predicted: FloatArray, outside: BoolArray,
                joint: int) -> Iterator[_Candidate]:
    q, qd = samples.q[:, joint], samples.qd[:, joint]
    yield from _bins('position', q, 'at {:.2f} to {:.2f} rad')
    yield ('direction', None, None, 'moving up', qd > COMPARISON.rest_speed)
    yield ('direction', None, None, 'moving down', qd < -COMPARISON.rest_speed)
    yield ('direction', None, None, 'standing still', np.abs(qd) <= COMPARISON.rest_speed)
    yield from _bins('speed', np.abs(qd), 'at a speed of {:.3f} to {:.3f} rad/s')
    yield from _bins('load', predicted[:, joint], 'at a load of {:.1f} to {:.1f} N·m')
    yield ('trained range', None, None, 'outside the trained range', outside)
    if samples.n_runs > 1:
        for number, label in enumerate(samples.run_labels):
            yield ('run', float(number), None, f'in run {label}', samples.runs == number)
    else:
        yield from _bins('time', samples.t - samples.t[0], 'from {:.1f} to {:.1f} s')


def _bins(axis: str, values: FloatArray, text: str) -> Iterator[_Candidate]:
    """Yield bins of equal width, not of equal sample numbers."""
    count = COMPARISON.bins
    if np.ptp(values) <= 0.0:
        return
    edges = np.linspace(values.min(), values.max(), count + 1)
    number = np.clip(np.searchsorted(edges, values, side='right') - 1, 0, count - 1)
    for k in range(count):
        low, high = float(edges[k]), float(edges[k + 1])
        yield axis, low, high, text.format(low, high), number == k


@dataclass(frozen=True)
class JointComparison:
    """
    One joint's residual, measured minus predicted torque, over `n` samples.

    `rmse`, `bias` (mean), `std` and `max_abs` are in N·m; rmse^2 = bias^2 + std^2. `nrmse` is
    the RMSE as a fraction of the range of the measured torque (Yu 2022, Eq. 16), None where
    that range is 0. `torque_std` is the standard deviation of the measured torque, in N·m: the
    RMSE of its mean as a constant prediction.

    `in_band` and `in_band_outside` are the shares of residuals inside the 95 % band where every
    joint is in its trained range, and of all others; None without such samples, or for a model
    without uncertainty. The band is 1.96 sqrt(std^2 + noise^2) with the standard deviation of the
    prediction (`effects.predict.static_std`) and the noise of training.
    """

    n: int
    rmse: float
    nrmse: float | None
    std: float
    bias: float
    max_abs: float
    torque_std: float
    where: tuple[ResidualRegion, ...]
    in_band: float | None = None
    in_band_outside: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Displayable):
    """
    The comparison of every joint; `residual` (M, N) in N·m.

    `share_outside` is the share of poses outside the trained range; `in_band` and
    `in_band_outside` are those of all joints.
    """

    joints: dict[str, JointComparison]
    residual: FloatArray
    share_outside: float
    in_band: float | None = None
    in_band_outside: float | None = None

    @property
    def worst(self) -> str:
        """Return the joint with the largest RMSE."""
        return max(self.joints, key=lambda name: self.joints[name].rmse)

    def summary(self) -> str:
        """Return one line: samples, and the joint with the largest error."""
        worst = self.joints[self.worst]
        return (f'error of the model on {worst.n} samples; largest on {self.worst}, RMSE '
                f'{worst.rmse:.4g} N·m')

    def details(self) -> Iterable[str | TextTable]:
        """Return the errors of every joint, and the worst regions of the worst joint."""
        yield self.table()
        yield from (f'{self.worst} {region.words}' for region in self.joints[self.worst].where[:2])

    def table(self, joints: Collection[str] = (), noise: Mapping[str, float] | None = None,
              previous: Mapping[str, float] | None = None, previous_name: str = '') -> TextTable:
        """
        Return the errors by joint, and that of a constant torque.

        :param joints: those to show; all if empty.
        :param noise: training RMSE in N·m by joint, if shown.
        :param previous: RMSE in N·m by joint of the model `previous_name`, if shown.
        """
        has_band = self.in_band is not None or self.in_band_outside is not None
        columns = ['joint', 'RMSE N·m', 'nRMSE', 'std N·m', 'max N·m',
                   *['training N·m'] * bool(noise), *['in band', 'outside'] * has_band,
                   *[f'{previous_name} N·m', 'change'] * bool(previous), 'constant N·m']
        rows = []
        for name in joints or self.joints:
            x = self.joints[name]
            row = [name, f'{x.rmse:.4f}', percent(x.nrmse), f'{x.std:.4f}', f'{x.max_abs:.3f}']
            row += [f'{noise[name]:.4f}'] if noise else []
            row += [percent(x.in_band), percent(x.in_band_outside)] if has_band else []
            if previous:
                row += [f'{previous[name]:.4f}', change(previous[name], x.rmse)
                        ] if name in previous else ['–', '–']
            rows.append((*row, f'{x.torque_std:.4f}'))
        return TextTable(tuple(columns), tuple(rows))

    def to_json(self) -> dict[str, Any]:
        """Return the document of `compare --json`."""
        return {'joints': {name: asdict(joint) for name, joint in self.joints.items()},
                'worst_joint': self.worst, 'share_outside_trained_range': self.share_outside,
                'in_band': self.in_band, 'in_band_outside': self.in_band_outside}


def compare(model: GravityModel, samples: JointSamples,
            recorded: JointSamples | None = None) -> Comparison:
    """
    Compare the prediction of `model`, effects included, with measured torques.

    Joints are matched by name.

    :param recorded: all samples, of which `samples` are a selection; effects may depend on the
        samples in between (acceleration, friction with memory).
    :raises ModelMismatchError: if a joint of the model is not among the samples, or an effect
        of the model is not installed.
    :raises DataError: if there are no samples.
    """
    samples = samples.joints(model.joints)
    if recorded is None or not model.applied.effects:
        predicted = predict_torque(model, samples)
    else:
        predicted = predict_torque(model, recorded)[numbers_in(recorded, samples)]
    band = None
    if model.covariance is not None:
        band = HALF_95 * np.hypot(static_std(model, samples.q), model.noise)
    return compare_prediction(samples, predicted,
                              model.coverage.distance(samples.q).max(axis=1) > 0.0, band)


def compare_prediction(samples: JointSamples, predicted: FloatArray, outside: BoolArray,
                       band: FloatArray | None = None) -> Comparison:
    """
    Compare predicted torques (M, N) with the samples' measured ones.

    :param outside: mask (M,) of poses outside the trained range.
    :param band: half-width (M, N) in N·m of the 95 % band.
    :raises DataError: if there are no samples.
    """
    if not samples.n_samples:
        raise DataError('no samples to compare with; none passed the gate, or the bag is empty')
    residual = samples.tau - predicted
    inside = None if band is None else np.abs(residual) <= band
    joints = {}
    for n, name in enumerate(samples.names):
        r, tau = residual[:, n], samples.tau[:, n]
        shares = _in_band(None if inside is None else inside[:, n], outside)
        rmse, torque_range = float(np.sqrt((r ** 2).mean())), float(np.ptp(tau))
        joints[name] = JointComparison(
            n=len(r), rmse=rmse, nrmse=rmse / torque_range if torque_range > 0.0 else None,
            std=float(r.std()), bias=float(r.mean()), max_abs=float(np.abs(r).max()),
            torque_std=float(tau.std()),
            where=tuple(find_regions(samples, predicted, outside, n)),
            in_band=shares[0], in_band_outside=shares[1])
    return Comparison(joints, residual, float(np.mean(outside)), *_in_band(inside, outside))


def _in_band(inside: BoolArray | None, outside: BoolArray) -> list[float | None]:
    """Return the shares inside the band, of samples inside and outside the trained range."""
    parts = [] if inside is None else [inside[~outside], inside[outside]]
    return [float(part.mean()) if part.size else None for part in parts] or [None, None]
