"""Update report: errors before and after, the payload, and warnings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.predict import static_std
from gravity_comp_ros.estimation.fit_report import std_over_poses, uncertainty_warning
from gravity_comp_ros.estimation.update_step import PayloadEstimate, UpdateStep
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.sparse.admm import AdmmResult
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.prior import Scale
import numpy as np

# Minimum number of samples from which the noise, and with it the intervals, are reliable.
_MIN_SAMPLES = 30
# Reported fields of ADMM's result.
_SOLVER = ('iterations', 'primal_residual', 'dual_residual', 'converged')


@dataclass(frozen=True)
class UpdateDetails:
    """
    The report of an update.

    By joint, in N·m: `rmse_before` and `rmse` of the models before and after, `noise`, the
    prediction's largest standard deviation `std`, and mean and largest torque of the payload.
    `changed` are changed coefficients of the model; `payload` is None without known axes.
    """

    n_samples: int
    rmse_before: Mapping[str, float]
    rmse: Mapping[str, float]
    noise: Mapping[str, float]
    std: Mapping[str, float]
    effect_mean: Mapping[str, float]
    effect_max: Mapping[str, float]
    changed: Mapping[str, float]
    payload: PayloadEstimate | None
    log_evidence: float
    solver: AdmmResult = field(compare=False)
    warnings: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the report for a model's provenance and for `update --json`."""
        solver = {name: getattr(self.solver, name) for name in _SOLVER}
        return {**vars(self), 'payload': None if self.payload is None else asdict(self.payload),
                'solver': solver, 'warnings': list(self.warnings)}


def details(old: GravityModel, step: UpdateStep, samples: JointSamples, rmse: FloatArray,
            sigma: FloatArray) -> UpdateDetails:
    """
    Return the report of an update.

    :param samples: as measured, in the joints' order of the model.
    :param rmse: of the new model on them (N,), N·m.
    :param sigma: noise (N,), N·m.
    """
    before = np.sqrt(((samples.tau - old.predict(samples.q)) ** 2).mean(axis=0))
    difference = step.model.predict(samples.q) - old.predict(samples.q)
    spread = static_std(step.model, samples.q).max(axis=0)
    warnings = uncertainty_warning(step.model, std_over_poses(step.model),
                                   Scale.of(samples, EngineOptions()).largest)
    if len(samples) < _MIN_SAMPLES:
        warnings.insert(0, f'{len(samples)} slow samples are few: the intervals of an update are '
                        f'reliable from {_MIN_SAMPLES} on (6 s at 5 Hz)')
    if step.payload is not None and not step.is_payload:
        warnings.append('a rigid body on the last link does not explain the change; mass and '
                        'centre of mass are only the nearest approximation')

    worse = [name for name, is_worse in zip(
        old.joints, rmse > before + old.noise_with_nuisance) if is_worse]
    if worse:
        warnings.append(f'no change of masses explains the recording: the error of '
                        f'{", ".join(worse)} is larger than before the update; it may be of '
                        f'another arm, or of another mounting')

    def by_joint(values: FloatArray) -> dict[str, float]:
        return dict(zip(old.joints, values.tolist()))

    return UpdateDetails(
        samples.n_samples, by_joint(before), by_joint(rmse),
        by_joint(sigma), by_joint(spread), by_joint(difference.mean(axis=0)),
        by_joint(np.abs(difference).max(axis=0)), step.changed, step.payload,
        step.change.log_evidence, step.change.lasso, tuple(warnings))
