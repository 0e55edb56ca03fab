"""
Gravity estimator: from samples to a gravity model and a fit report.

Friction, offsets, inertia and every other effect that the samples show are fitted jointly with
gravity (`regression`). The model stores them and does not predict them; `add` switches them on.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gravity_comp_ros.data.samples import BoolArray, JointSamples
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.registry import Request
from gravity_comp_ros.effects.rigid_body import DYNAMICS
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.estimation.estimate import (
    Estimate, estimate, estimate_again, FitOptions, Progress)
from gravity_comp_ros.estimation.estimated_model import model_of
from gravity_comp_ros.estimation.fit_report import build_report, FitDetails
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.regression.term import Key


@dataclass(frozen=True)
class FitResult:
    """A model, a report, the estimate, and whether axes and L1 problems converged."""

    model: GravityModel
    report: FitDetails
    converged: bool
    estimate: Estimate

    def to_json(self) -> dict[str, Any]:
        """Return `joints`, `report` and `converged` as `fit --json` prints them."""
        model, report = self.model, self.report
        joints = {name: {
            'features': report.features[name], 'rmse': report.rmse[name],
            'noise': report.noise[name],
            'q_min': model.coverage.q_min[n], 'q_max': model.coverage.q_max[n],
            'equation': model.equation(name)} for n, name in enumerate(model.joints)}
        return {'joints': joints, 'report': report.to_json(), 'converged': self.converged}

    def with_warning(self, warning: str) -> FitResult:
        """Return the same with another first warning, in the report and in the provenance."""
        warnings, provenance = (warning, *self.report.warnings), self.model.provenance
        provenance = {**provenance,
                      'report': {**provenance['report'], 'warnings': list(warnings)}}
        return replace(self, report=replace(self.report, warnings=warnings),
                       model=replace(self.model, provenance=provenance))


def fit(samples: JointSamples, options: FitOptions = FitOptions(),
        progress: Progress | None = None, old: GravityModel | None = None,
        use: BoolArray | None = None, effects: Sequence[Request] = (),
        tested: Sequence[Effect] | None = None) -> FitResult:
    """
    Learn the gravity torque from samples of any speed.

    :param progress: called with a word and a share from 0 to 1.
    :param old: a model of the same joints as the start of the search; it is no constraint.
    :param use: mask (M,) of the samples to fit; None for all. The others are the motion between
        them, on which accelerations and friction with memory depend.
    :param effects: those that the model predicts.
    :param tested: the effects that may be in the model; all by default.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises DataError: if the samples do not excite an effect that was requested on a joint.
    :raises ModelMismatchError: if the options have the axes of other joints.
    """
    forced = keys_of([request.target for request in effects], samples.names)
    estimated = estimate(samples, options, use, old, forced, tested, progress)
    return result_of(estimated, options, excited(estimated, effects)[0])


def fit_again(earlier: FitResult, options: FitOptions, samples: JointSamples | None = None,
              formulation: str = '') -> FitResult:
    """
    Return a fit with the effects of an earlier one (`estimate_again`).

    :raises FitError: if there are too few samples, or no joint moves.
    """
    again = estimate_again(earlier.estimate, options, samples, formulation)
    return result_of(again, options, [effect.target for effect in earlier.model.applied.effects])


def result_of(estimated: Estimate, options: FitOptions, effects: Collection[str] = ()
              ) -> FitResult:
    """Return the model of an estimate, which predicts some effects, with its report."""
    model = model_of(estimated, effects)
    report = build_report(model, estimated, options)
    model = replace(model, provenance={'options': options.to_json(), 'report': report.to_json()})
    converged = estimated.regression.converged and all(
        each.lasso.converged for each in estimated.fits)
    return FitResult(model, report, converged, estimated)


def excited(estimated: Estimate, effects: Sequence[Request]) -> tuple[list[str], dict[str, str]]:
    """
    Return the targets of the effects that the samples excite, and why the others are left out.

    :raises DataError: if an effect that was requested on a joint is not excited.
    """
    regression = estimated.regression
    terms = {term.key for term in regression.terms}
    targets, left_out = [], {}
    for request in effects:
        key = key_of(request.target, regression.problem.samples.names)
        reason = (request.effect.untestable(regression.motion, 0) if request.effect.is_shared
                  else regression.candidates.untestable.get(key))
        if key in terms or reason is None:
            targets.append(request.target)
        elif request.named:
            raise DataError(f'{request.target} cannot be estimated: {reason}')
        else:
            left_out[request.target] = reason
    return targets, left_out


def keys_of(targets: Iterable[str], joints: tuple[str, ...]) -> frozenset[Key]:
    """Return the keys of the terms of targets; dynamics are in every estimate."""
    return frozenset(key_of(name, joints) for name in targets if name != DYNAMICS)


def key_of(name: str, joints: tuple[str, ...]) -> Key:
    """Return the key of a target `NAME:JOINT`, or `NAME` for the whole arm."""
    effect, _, joint = name.partition(':')
    return effect, joints.index(joint) if joint else None
