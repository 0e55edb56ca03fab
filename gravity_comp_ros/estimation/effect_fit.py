"""
Joint fit of gravity and effects: gravity is selected again, jointly with the effects' columns.

Some columns depend on gravity (load-dependent friction, joint elasticity, rigid-body dynamics).
They are computed from the fitted gravity, their coefficients are solved again, and the fit is
repeated. A round is accepted only if the RMSE of the model's own prediction falls, so the
iteration cannot diverge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.acceleration import is_resolved
from gravity_comp_ros.data.condense import Condensation, condense
from gravity_comp_ros.data.samples import evenly_picked, FloatArray, IntArray, JointSamples
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_fit import samples_per_observation
from gravity_comp_ros.effects.predict import (
    direction_of, effect_torque, installed, predict_on)
from gravity_comp_ros.effects.request import known_effect
from gravity_comp_ros.estimation.clustered import clustered_std
from gravity_comp_ros.estimation.fit import (
    Estimate, estimate_gravity, FitOptions, gravity_model)
from gravity_comp_ros.estimation.inertia import is_fast
from gravity_comp_ros.estimation.nominal_motion import MOTION_EFFECTS
from gravity_comp_ros.estimation.refit_terms import Term
from gravity_comp_ros.estimation.regression import build_regression
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.models.nuisance import COULOMB, INERTIA, OFFSET, VISCOUS
from gravity_comp_ros.models.sparse.weighted_nuisance import WeightedNuisance
import numpy as np

# Maximum number of rounds. Without a description, lengths and axes converge over several rounds.
_MAX_ROUNDS = 8
# Effects, and the nuisance terms that they replace.
_REPLACED = {'coulomb_friction': COULOMB, 'asymmetric_friction': COULOMB,
             'viscous_friction': VISCOUS, 'torque_offset': OFFSET, 'inertia': INERTIA,
             'rigid_body_dynamics': INERTIA}
# Maximum relative change of the columns at convergence, and minimum relative decrease of the
# RMSE by a round.
_CONVERGED, _MIN_DECREASE = 0.01, 1e-3
# Maximum number of rows of the unweighted fit that gives the noise level.
_MAX_NOISE_ROWS = 1500


@dataclass(frozen=True, eq=False)
class EffectFit:
    """
    The model with its effects, the estimate of gravity, and the RMSE (N,) of its prediction.

    `dynamics` is True if rigid-body dynamics was a nuisance term; `residual_rms` in N·m is the
    RMSE over all joints with this term subtracted.
    """

    model: GravityModel
    estimate: Estimate
    rmse: FloatArray
    dynamics: bool
    residual_rms: float


def fit_with_terms(motion: Motion, rows: IntArray, model: GravityModel, terms: Sequence[Term],
                   kept: tuple[AppliedEffect, ...], options: FitOptions,
                   known: FloatArray | None = None, warm: bool = False,
                   excluded: frozenset[tuple[str, int]] = frozenset()) -> EffectFit:
    """
    Return gravity and effects, fitted jointly to some rows of a motion.

    :param motion: of all samples, because some columns depend on earlier samples.
    :param rows: the samples (R,) to fit.
    :param model: the initial gravity; its joints are those of the motion.
    :param kept: effects with fixed coefficients.
    :param known: axes (N, 3, 3) of a chain that need no search.
    :param warm: whether the chain of the model is the only start of the search.
    :param excluded: nuisance terms that are not fitted, as kind and joint number.
    """
    if all(effect.pointwise for effect in (*(term.effect for term in terms),
                                           *map(installed, kept))):
        motion, rows = motion.at(rows), np.arange(len(rows))
    best: EffectFit | None = None
    dynamics = _dynamics_term(motion.at(rows), (*terms, *kept))
    if dynamics:
        # Its columns need axes and moments, which only a chain provides.
        options = FitOptions('chain', options.sparse)
    columns = _columns(motion, rows, (*terms, *dynamics))
    for _ in range(_MAX_ROUNDS):
        fit, motion_after, columns_after = _fit_once(motion, rows, model, (terms, dynamics), kept,
                                                     columns, options, known, warm, excluded)
        if best is not None and fit.residual_rms >= (1.0 - _MIN_DECREASE) * best.residual_rms:
            break
        best, warm = fit, True
        if _converged(columns, columns_after):
            break
        motion, model, columns = motion_after, fit.model, columns_after
    assert best is not None
    return best


def _dynamics_term(motion: Motion, present: Sequence[Term | AppliedEffect]) -> tuple[Term, ...]:
    """
    Return rigid-body dynamics if it must be a nuisance term of a motion, () otherwise.

    :param present: the effects of the model.
    """
    effect = known_effect('rigid_body_dynamics')
    if (_names(present) & set(MOTION_EFFECTS) or not is_fast(motion.samples)
            or motion.serial_arm is None or effect.untestable(motion, 0) is not None):
        return ()
    return (Term(effect, None, effect.settings(motion, 0)[0]),)


def _nominal_axes(model: GravityModel, present: Sequence[Term | AppliedEffect],
                  known: FloatArray | None) -> Geometry | None:
    """Return the known axes (N, 3, 3) if no effect describes the dynamic torque."""
    if known is None or model.geometry is None or _names(present) & set(MOTION_EFFECTS):
        return None
    return replace(model.geometry, rotations=known)


def _names(present: Sequence[Term | AppliedEffect]) -> set[str]:
    return {each.effect.name if isinstance(each, Term) else each.name for each in present}


def _fit_once(motion: Motion, rows: IntArray, model: GravityModel,
              effects_and_nuisance: tuple[Sequence[Term], Sequence[Term]],
              kept: tuple[AppliedEffect, ...], columns: FloatArray, options: FitOptions,
              known: FloatArray | None, warm: bool, excluded: frozenset[tuple[str, int]]
              ) -> tuple[EffectFit, Motion, FloatArray]:
    """
    Return a fit, and the motion and the columns (K, R, N) for the fitted gravity.

    :param effects_and_nuisance: the effects of the model, and those that are nuisance terms.
    """
    effects, nuisance = effects_and_nuisance
    terms = (*effects, *nuisance)
    part = motion.samples.select(rows)
    if is_resolved(motion.samples):
        part = replace(part, qdd=motion.qdd[rows])
    fixed = np.zeros(part.tau.shape)
    if kept:
        fixed = effect_torque(_with_effects(model, kept, motion), motion.samples)[rows]
    target = replace(part, tau=part.tau - fixed)
    condensation = condense(target)
    few, dense = condensation.samples(target), _condensed(condensation, columns)
    regression = build_regression(
        target, effects=dense, condensation=condensation,
        excluded=excluded | replaced_terms(motion, terms),
        effect_std=_prior_std(motion, terms, few, dense),
        geometry=_nominal_axes(model, (*terms, *kept), known))
    estimate = estimate_gravity(regression, options, model, known, warm)
    gravity = replace(gravity_model(estimate, part), history=model.history,
                      provenance=model.provenance, geometry=model.geometry)
    motion_after = motion.with_model(gravity)
    columns_after = _columns(motion_after, rows, terms)
    if (not _converged(columns, columns_after)
            and _symbols(motion, terms) == _symbols(motion_after, terms)):
        # Columns that depend on gravity have changed with it.
        dense = _condensed(condensation, columns_after)
        prior_std = _prior_std(motion_after, terms, few, dense)
        estimate = replace(estimate, effects=_solve_again(estimate, gravity, dense, prior_std))
        columns = columns_after
    applied = for_gravity(gravity, motion, (*kept, *_applied(motion, effects, estimate)))
    fitted = _with_effects(gravity, applied, motion)
    residual = motion.samples.tau[rows] - predict_on(fitted, motion, rows)
    rmse = np.sqrt((residual ** 2).mean(axis=0))
    n = len(columns) - sum(len(term.coefficients(motion)) for term in nuisance)
    residual = residual - np.tensordot(estimate.effects[n:], columns[n:], axes=1)
    residual_rms = float(np.sqrt((residual ** 2).mean()))
    return (EffectFit(replace(fitted, noise=rmse), estimate, rmse, bool(nuisance), residual_rms),
            motion_after, columns_after)


def _condensed(condensation: Condensation, columns: FloatArray) -> FloatArray | None:
    """Return columns (K, R, N) of condensed samples, (K, N, m); None if there are none."""
    return np.stack([condensation.mean(column) for column in columns]).transpose(0, 2, 1) \
        if len(columns) else None


def _solve_again(estimate: Estimate, gravity: GravityModel, columns: FloatArray | None,
                 prior_std: FloatArray | None) -> FloatArray:
    """Return the coefficients (K,) of changed columns (K, N, m) with gravity fixed."""
    regression = replace(estimate.regression, effects=columns, effect_std=prior_std)
    terms = regression.linear_terms()
    weights = regression.row_weights(estimate.choice.estimate.residual()).T
    residual = regression.samples.tau - gravity.predict(regression.samples.q)
    solver = WeightedNuisance(terms.columns, weights, terms.spread)
    return solver.coefficients(weights * residual.T)[:regression.n_effects]


def replaced_terms(motion: Motion, terms: Sequence[Term]) -> frozenset[tuple[str, int]]:
    """Return the nuisance terms that effects replace, as kind and joint number."""
    return frozenset((_REPLACED[term.effect.name], n) for term in terms
                     if term.effect.name in _REPLACED
                     for n, name in enumerate(motion.samples.names) if term.joint in (None, name))


def _columns(motion: Motion, rows: IntArray, terms: Sequence[Term]) -> FloatArray:
    """Return the columns (K, R, N) of all terms at some rows."""
    names, n = motion.samples.names, motion.samples.n_joints
    parts = [np.zeros((0, len(rows), n))]
    for term in terms:
        joint = term.joint_index(names)
        own = term.effect.columns(motion, joint, term.setting)[rows]
        if own.ndim == 2:
            whole = np.zeros((own.shape[1], len(rows), n))
            whole[:, :, joint] = own.T
        else:
            whole = own.transpose(2, 0, 1)
        parts.append(whole)
    return np.concatenate(parts)


def _symbols(motion: Motion, terms: Sequence[Term]) -> list[tuple[str, ...]]:
    """Return the symbols of each term's coefficients."""
    return [tuple(c.symbol for c in term.coefficients(motion)) for term in terms]


def _prior_std(motion: Motion, terms: Sequence[Term], samples: JointSamples,
               columns: FloatArray | None) -> FloatArray | None:
    """
    Return the prior standard deviations (K,) of the terms' coefficients, per N·m of noise.

    None if no term has a prior.

    :param samples: those that are fitted, M of them.
    :param columns: (K, N, M), of the terms.
    """
    parts, has_prior = [np.zeros(0)], False
    for term in terms:
        std = term.effect.spread(motion, term.joint_index(motion.samples.names), term.setting)
        parts.append(np.full(len(term.coefficients(motion)), np.inf) if std is None else std)
        has_prior = has_prior or std is not None
    if not has_prior or columns is None:
        return None
    noise = np.sqrt(samples_per_observation(samples)) * _noise_std(motion, samples, columns)
    lengths = np.sqrt((columns ** 2).sum(axis=(1, 2)))
    weighted = np.sqrt(((columns / noise[:, None]) ** 2).sum(axis=(1, 2)))
    # A column that this motion does not excite has no prior.
    excited = lengths > 0.0
    return np.where(excited, np.concatenate(parts) * weighted / np.where(excited, lengths, 1.0),
                    np.inf)


def _noise_std(motion: Motion, samples: JointSamples, columns: FloatArray) -> FloatArray:
    """Return the residual std (N,) in N·m of a joint fit of gravity and columns (K, N, M)."""
    assert motion.model is not None
    part = evenly_picked(samples.n_samples, _MAX_NOISE_ROWS)
    q = samples.q[part]
    residual = samples.tau[part] - motion.model.predict(q)
    flat = columns[:, :, part].transpose(2, 1, 0).reshape(residual.size, -1)
    if motion.serial_arm is not None:
        gravity = motion.serial_arm.jacobian(q).transpose(2, 1, 0)
        flat = np.hstack([flat, gravity.reshape(residual.size, -1)])
    size = np.maximum(np.sqrt((flat ** 2).mean(axis=0)), 1e-300)
    x = lstsq(flat / size, residual.ravel(), rcond=1e-9)
    std = (residual - ((flat / size) @ x).reshape(residual.shape)).std(axis=0)
    return np.asarray(np.maximum(std, 1e-3 * max(float(std.max()), 1e-9)))


def _applied(motion: Motion, terms: Sequence[Term], estimate: Estimate) -> list[AppliedEffect]:
    """Return the terms with their coefficients and 95 % intervals."""
    if not terms:
        return []
    std, quantile = clustered_std(estimate)
    applied, first = [], 0
    for term in terms:
        coefficients = term.coefficients(motion)
        values = {}
        for k, coefficient in enumerate(coefficients, first):
            x, half = float(estimate.effects[k]), float(quantile * std[k])
            values[coefficient.symbol] = Value(x, coefficient.unit, (x - half, x + half))
        applied.append(AppliedEffect(term.effect.name, term.joint, dict(term.setting), values))
        first += len(coefficients)
    return applied


def for_gravity(gravity: GravityModel, motion: Motion,
                effects: tuple[AppliedEffect, ...]) -> tuple[AppliedEffect, ...]:
    """
    Return effects with the coefficients that they have for another gravity.

    Some coefficients belong to parts of gravity. Those of missing parts are dropped; those of
    new parts are 0.
    """
    if all(installed(applied).has_fixed_coefficients for applied in effects):
        return effects
    motion = motion.with_model(gravity)
    result = []
    for applied in effects:
        joint = 0 if applied.joint is None else motion.samples.names.index(applied.joint)
        symbols = installed(applied).coefficients_of(motion, joint, applied.setting)
        result.append(replace(applied, coefficients={
            c.symbol: applied.coefficients.get(c.symbol, Value(0.0, c.unit, (0.0, 0.0)))
            for c in symbols}))
    return tuple(result)


def _with_effects(model: GravityModel, effects: tuple[AppliedEffect, ...],
                  motion: Motion) -> GravityModel:
    return replace(model, applied=Applied(effects, direction_of(motion)))


def _converged(one: FloatArray, other: FloatArray) -> bool:
    return one.shape == other.shape and bool(
        np.linalg.norm(one - other) <= _CONVERGED * max(float(np.linalg.norm(other)), 1e-300))
