"""
Effects added to a model: the same estimate with other switches, judged on held-out data.

The effects that a fit found are a part of its posterior already, so that adding one changes what
is predicted and nothing else. An effect that was not found is forced into the estimate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.effects.registry import all_effects, Request
from gravity_comp_ros.effects.rigid_body import DYNAMICS
from gravity_comp_ros.errors import DataError, FitError
from gravity_comp_ros.estimation.estimate import Estimate, estimate, FitOptions, Progress
from gravity_comp_ros.estimation.estimated_model import (
    alternatives_of, gain_of_dynamics, has_dynamics, is_absorbed, model_of, target_of)
from gravity_comp_ros.estimation.fit import excited, keys_of
from gravity_comp_ros.estimation.held_out import held_out_torques, HeldOutTorques
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.models.gravity_model import CHOICES, GravityModel
from gravity_comp_ros.regression.gains import p_of
import numpy as np


_PRESENT = 'it is in the model already'


@dataclass(frozen=True)
class HeldOut:
    """
    A joint's held-out RMSE in N·m without and with the new effects.

    `torque_range` is the range of its measured torque in N·m, 0 if it is constant.
    """

    before: float
    after: float
    torque_range: float

    @property
    def nrmse_before(self) -> float | None:
        """Return the error before as a share of the torque's range (Yu 2022, Eq. 16)."""
        return self.before / self.torque_range if self.torque_range > 0.0 else None

    @property
    def nrmse_after(self) -> float | None:
        """Return the error after as a share of the torque's range (Yu 2022, Eq. 16)."""
        return self.after / self.torque_range if self.torque_range > 0.0 else None


@dataclass(frozen=True)
class Refit:
    """
    A model with effects, and its errors on held-out samples.

    `added` are targets; `errors` the held-out errors by joint; `p` is the
    p-value of the new effect with the largest gain, and `helps` whether that is enough for a
    finding. `n_samples` were fitted. `skipped` are omitted effects with the reason, `implausible`
    those in the model with coefficients that are not physical, `ties` those that others explain
    as well.
    """

    model: GravityModel
    added: tuple[str, ...]
    errors: Mapping[str, HeldOut]
    p: float
    helps: bool
    n_samples: int
    skipped: Mapping[str, str]
    implausible: Mapping[str, str]
    ties: Mapping[str, tuple[str, ...]]

    def warnings(self) -> list[str]:
        """Return warnings about the new effects."""
        lines = [f'{name} is not physical: {why}' for name, why in self.implausible.items()]
        if not self.helps:
            lines.append('the evidence for the new effects is too small for a finding: these '
                         'recordings do not require them, or gravity has absorbed them already')
        return lines

    def by_joint(self) -> tuple[dict[str, float], dict[str, float]]:
        """Return held-out RMSE in N·m by joint, before and after."""
        return ({name: e.before for name, e in self.errors.items()},
                {name: e.after for name, e in self.errors.items()})

    def to_json(self) -> dict[str, Any]:
        """Return the refit as `add --json` prints it; errors in N·m, shares of the range."""
        return {
            'added': list(self.added),
            'held_out': {name: {'rmse_before': e.before, 'rmse_after': e.after,
                                'nrmse_before': e.nrmse_before, 'nrmse_after': e.nrmse_after}
                         for name, e in self.errors.items()},
            'effects': [{'target': e.target, **asdict(e)} for e in self.model.applied.effects],
            'p': self.p, 'n_samples': self.n_samples,
            'left_out': dict(self.skipped), 'implausible': dict(self.implausible)}


def refit(samples: JointSamples, model: GravityModel, effects: Sequence[Request],
          use: BoolArray | None = None, progress: Progress | None = None) -> Refit:
    """
    Return the model with the wanted effects; gravity is estimated jointly with them.

    :param samples: as recorded, fast motion included, because accelerations and friction with
        memory depend on the samples in between.
    :param use: which samples (M,) may be fitted; None for all.
    :raises DataError: if an effect is in the model already or not identifiable, or samples are
        too few.
    :raises FitError: if an effect increases the held-out error of a joint.
    :raises ModelMismatchError: if a joint of the model is not among the samples, or an effect
        of the model is not installed.
    """
    samples = samples.joints(model.joints)
    missing, present = _missing(model, effects)
    old = [effect.target for effect in model.applied.effects]

    def with_forced(targets: Sequence[str]) -> Estimate:
        return estimate(samples, fit_options_of(model), use, model,
                        keys_of(targets, model.joints), None, progress)

    estimated = with_forced((*old, *(request.target for request in missing)))
    new, skipped = excited(estimated, missing)
    skipped |= dict.fromkeys(present, _PRESENT)
    if effects and not new:
        raise DataError('; '.join(f'{name}: {why}' for name, why in skipped.items()))
    torques = held_out_torques(estimated)
    after = torques.residual(_predicted(estimated, (*old, *new)))
    before = torques.residual(_predicted(estimated, old))
    if any(is_absorbed(estimated, term) for term in estimated.regression.terms
           if target_of(term, model.joints) in new):
        # Terms that gravity or each other absorb are predicted above, in the model they are not.
        earlier = with_forced(old)
        before = held_out_torques(earlier).residual(_predicted(earlier, old))
    errors = _errors(torques, before, after, model.joints)
    if new:
        _check_not_worse(errors)
    fitted = model_of(estimated, (*old, *new))
    provenance = dict(model.provenance)
    gain, evidence = _gain(estimated, new)
    return Refit(replace(fitted, provenance=provenance, history=model.history), tuple(new), errors,
                 p_of(evidence), gain >= estimated.regression.problem.options.min_gain,
                 len(samples) if use is None else int(use.sum()), skipped,
                 _implausible(fitted, new), _ties(estimated, new))


def fit_options_of(model: GravityModel) -> FitOptions:
    """Return the options with which a model was fitted: its formulation and known axes."""
    requested = (model.provenance.get('options') or {}).get('formulation', 'auto')
    formulation = requested if requested in CHOICES else 'auto'
    if model.geometry is not None:
        return FitOptions('chain', geometry=model.geometry)
    return FitOptions(model.formulation if formulation == 'auto' else formulation)


def _missing(model: GravityModel, effects: Sequence[Request]) -> tuple[list[Request], list[str]]:
    """
    Return the requested effects that the model does not have, and the targets of the others.

    :raises DataError: if an effect of the model was requested on a joint.
    """
    present = [request for request in effects
               if model.applied.has(request.effect.name, request.joint)]
    named = [request.target for request in present if request.named]
    if named:
        raise DataError(f'{named[0]} cannot be added: {_PRESENT} (an undo, `gravity_comp add '
                        f'--undo`, removes the last addition)')
    return ([request for request in effects if request not in present],
            [request.target for request in present])


def _predicted(estimated: Estimate, targets: Sequence[str]) -> set[str]:
    """Return the targets that a model with these effects predicts."""
    model = model_of(estimated, targets, with_noise=False)
    return {effect.target for effect in model.applied.effects}


def _errors(torques: HeldOutTorques, before: FloatArray, after: FloatArray,
            joints: tuple[str, ...]) -> dict[str, HeldOut]:
    """Return the held-out errors of residuals (U, N) without and with the new effects."""
    spans = np.ptp(torques.tau, axis=0)
    old, new = (np.sqrt((residual ** 2).mean(axis=0)) for residual in (before, after))
    return {name: HeldOut(float(old[n]), float(new[n]), float(spans[n]))
            for n, name in enumerate(joints)}


def _check_not_worse(errors: Mapping[str, HeldOut]) -> None:
    worst = max(errors, key=lambda name: errors[name].after / max(errors[name].before, 1e-12))
    error = errors[worst]
    if error.after > (1.0 + OPTIONS.max_increase) * error.before:
        raise FitError(f'these effects increase the held-out error of joint {worst} from '
                       f'{error.before:.3g} to {error.after:.3g} N·m. Nothing is changed; add '
                       f'fewer effects, or record more motion')


def _gain(estimated: Estimate, targets: Sequence[str]) -> tuple[float, float]:
    """Return the largest gain of new effects in nats, with and without its prior odds."""
    regression, joints = estimated.regression, estimated.regression.problem.samples.names
    gains = [(gain := regression.gains[term.key], gain - term.log_prior)
             for term in regression.terms if target_of(term, joints) in targets]
    if DYNAMICS in targets and has_dynamics(regression.shared):
        gains.append((gain := gain_of_dynamics(regression), gain))
    return max(gains, default=(-np.inf, -np.inf))


def _ties(estimated: Estimate, targets: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the effects that explain the data as well as a new one, by its target."""
    regression = estimated.regression
    joints = regression.problem.samples.names
    others = {target_of(term, joints): alternatives_of(regression, term, joints)
              for term in regression.terms}
    return {name: others[name] for name in targets if others.get(name)}


def _implausible(model: GravityModel, targets: Sequence[str]) -> dict[str, str]:
    """Return the new effects with coefficients that are not physical, and the reasons."""
    reasons, known = {}, all_effects()
    for effect in model.applied.effects:
        if effect.target in targets:
            values = np.array([c.value for c in effect.coefficients.values()])
            reason = known[effect.name].implausible(values, effect.setting)
            if reason:
                reasons[effect.target] = reason
    return reasons
