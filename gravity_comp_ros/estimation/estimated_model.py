"""The model of an estimate: gravity with its uncertainty, and effects with their coefficients."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import TypeGuard

from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import Coefficients
from gravity_comp_ros.effects.predict import fitted_torque, predict_torque
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.effects.rigid_body import DYNAMICS
from gravity_comp_ros.estimation.estimate import Estimate
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, target, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.chain import expand
from gravity_comp_ros.regression.dictionary_columns import Energy, Torques
from gravity_comp_ros.regression.engine import Regression
from gravity_comp_ros.regression.known_axes import KnownAxes
from gravity_comp_ros.regression.linear import Linear
from gravity_comp_ros.regression.posterior import Posterior
from gravity_comp_ros.regression.shared import Shared, State
from gravity_comp_ros.regression.term import Term
from gravity_comp_ros.regression.unknown_lengths import UnknownLengths
import numpy as np
from scipy.linalg import block_diag


def is_absorbed(estimate: Estimate, term: Term) -> bool:
    """Return whether gravity absorbs a static term nearly whole in the fitted motion."""
    regression = estimate.regression
    limit = regression.problem.options.min_separate
    return term.effect.is_static and bool(regression.identified[term.key].max() < limit)


def gain_of_dynamics(regression: Regression) -> float:
    """
    Return the log evidence of dynamics: that of the same terms on the motion and on still states.

    Gravity is estimated again without dynamics. In slow motion the accelerations are nearly
    collinear with it, so that a model from which dynamics are only omitted is always worse.
    """
    problem, posterior = regression.problem, regression.posterior
    state = problem.states.state
    still = State(state.q, np.zeros_like(state.qd), np.zeros_like(state.qdd))
    without = replace(problem, states=replace(problem.states, state=still))
    evidences = [Linear.at(each, regression.shared, each.factory(regression.shared),
                           posterior.terms, posterior.design.root.T ** 2,
                           posterior.precision).posterior.log_evidence
                 for each in (problem, without)]
    return evidences[0] - evidences[1]


def target_of(term: Term, joints: tuple[str, ...]) -> str:
    """Return `NAME:JOINT` of a term, or `NAME` for the whole arm."""
    return target(term.name, None if term.joint is None else joints[term.joint])


def model_of(estimate: Estimate, switched_on: Collection[str] = (),
             posterior: Posterior | None = None, with_noise: bool = True) -> GravityModel:
    """
    Return the model of an estimate.

    Static terms that gravity absorbs nearly whole are predicted as well: their sum with gravity is
    identified, their split is not.

    :param switched_on: targets (`NAME:JOINT`) of the effects that the model predicts.
    :param posterior: another posterior of the same terms, such as that of a fold.
    :param with_noise: whether the noise is computed from the prediction of the fitted samples.
    """
    regression = estimate.regression
    problem, joints = regression.problem, regression.problem.samples.names
    posterior = posterior or regression.posterior
    shared = regression.shared.moved(posterior.beta[:len(regression.shared.point)])
    used = problem.measured.select(problem.used)
    model = _gravity(shared, joints, Coverage.of(used), estimate.formulation)
    predicted: list[AppliedEffect] = []
    fitted: list[AppliedEffect] = []
    for term in posterior.terms:
        effect = _applied(estimate, posterior, term, joints)
        chosen = effect.target in switched_on or is_absorbed(estimate, term)
        (predicted if chosen else fitted).append(effect)
    if has_dynamics(shared) and all_effects()[DYNAMICS].untestable(regression.motion, 0) is None:
        dynamics = _dynamics(estimate, shared, posterior)
        (predicted if DYNAMICS in switched_on else fitted).append(dynamics)
    model = replace(model, applied=Applied(tuple(predicted)), fitted=Applied(tuple(fitted)))
    if not isinstance(shared, Torques):
        static = [term for term in posterior.terms if term.effect.is_static]
        model = replace(model, static=tuple(target_of(term, joints) for term in static),
                        covariance=_covariance(shared, regression, static))
    return with_residuals(model, estimate) if with_noise else model


def with_residuals(model: GravityModel, estimate: Estimate) -> GravityModel:
    """Return a model with the RMS of its prediction's error, and of the residual of all terms."""
    problem = estimate.regression.problem
    samples, rows = problem.measured, problem.used
    error = (samples.tau - predict_torque(model, samples))[rows]
    rest = error - fitted_torque(model, samples)[rows]
    return replace(model, noise=_rms(error), residual_std=_rms(rest))


def has_dynamics(shared: Shared) -> TypeGuard[KnownAxes | UnknownLengths]:
    """Return whether the shared part contains the dynamics of the arm."""
    return isinstance(shared, (KnownAxes, UnknownLengths))


def motion_parameters(shared: KnownAxes | UnknownLengths, parameters: FloatArray) -> FloatArray:
    """Return the parameters of motion among those of the shared part, in the effect's order."""
    if isinstance(shared, KnownAxes):
        return parameters[2 + shared.geometry.n_joints:]
    return parameters[4 * shared.chain.n_joints:]


def _gravity(shared: Shared, joints: tuple[str, ...], coverage: Coverage,
             formulation: str) -> GravityModel:
    none = np.zeros(len(joints))
    if isinstance(shared, Torques):
        return GravityModel(joints, formulation, shared.torques, None, none, coverage)
    if isinstance(shared, Energy):
        return GravityModel.from_energy(joints, formulation, shared.energy, none, coverage, {})
    assert has_dynamics(shared)
    model = GravityModel.from_energy(joints, formulation, expand(shared.chain), none, coverage, {},
                                     shared.chain)
    return replace(model, geometry=shared.geometry if isinstance(shared, KnownAxes) else None)


def _covariance(shared: Shared, regression: Regression, static: Iterable[Term]) -> FloatArray:
    """Return the covariance of the parameters of gravity and of the static terms."""
    p, at = len(shared.point), regression.posterior.at
    steps = shared.step_map() if has_dynamics(shared) else np.eye(p)
    here = np.concatenate([np.arange(p), *(at[term] for term in static)])
    to_model = block_diag(steps, np.eye(len(here) - p))
    return np.asarray(to_model @ regression.uncertainty.covariance[np.ix_(here, here)]
                      @ to_model.T)


def _applied(estimate: Estimate, posterior: Posterior, term: Term,
             joints: tuple[str, ...]) -> AppliedEffect:
    """Return a term with its coefficients and their intervals."""
    effect, motion = term.effect, estimate.regression.motion
    stds = estimate.regression.uncertainty.stds[term.key]
    return AppliedEffect(
        term.name, None if term.joint is None else joints[term.joint], term.setting,
        values_of(effect.coefficients_of(motion, term.joint_number, term.setting),
                  posterior.beta[posterior.at[term]], stds))


def _dynamics(estimate: Estimate, shared: KnownAxes | UnknownLengths,
              posterior: Posterior) -> AppliedEffect:
    effect, p = all_effects()[DYNAMICS], len(shared.point)
    std = np.sqrt(np.maximum(np.diag(posterior.covariance)[:p], 0.0))
    listed = effect.coefficients_of(estimate.regression.motion, 0, {})
    return AppliedEffect(DYNAMICS, None, {}, values_of(
        listed, motion_parameters(shared, shared.point), motion_parameters(shared, std)))


def alternatives_of(regression: Regression, term: Term, joints: tuple[str, ...]
                    ) -> tuple[str, ...]:
    """Return the effects that explain the data as well; with their joint if it is another one."""
    return tuple(name if joint == term.joint else target(
        name, None if joint is None else joints[joint])
        for name, joint in regression.alternatives[term.key])


def values_of(listed: Coefficients, values: FloatArray,
              std: FloatArray) -> Mapping[str, Value]:
    """Return coefficients (K,) with their 95 % intervals, by symbol."""
    return {c.symbol: Value.around(x, c.unit, HALF_95 * s)
            for c, x, s in zip(listed, values, std)}


def _rms(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((values ** 2).mean(axis=0)))
