"""
Gravity and effects together: gravity is selected anew beside the effects' columns.

Some columns are made of gravity (load-dependent friction, joint elasticity, rigid-body dynamics).
They are computed from the gravity that was found, their coefficients are solved again beside it,
and the fit is repeated; a round counts only if the RMSE of the model's own prediction falls, so
that the repetition cannot diverge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from gravity_comp_ros.estimation.nominal_motion import MOTION_EFFECTS
from gravity_comp_ros.estimation.refit_terms import Term
from gravity_comp_ros.estimation.regression import build_regression, is_fast
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.models.nuisance import COULOMB, INERTIA, OFFSET, VISCOUS
from gravity_comp_ros.models.sparse.weighted_nuisance import WeightedNuisance
import numpy as np

# Lengths and axes of an arm without a description move each other for some rounds.
_ROUNDS = 8
# Effects and the nuisance terms whose place they take.
_REPLACED = {'coulomb_friction': COULOMB, 'asymmetric_friction': COULOMB,
             'viscous_friction': VISCOUS, 'torque_offset': OFFSET, 'inertia': INERTIA,
             'rigid_body_dynamics': INERTIA}
# Columns that change by less than this share are the same; a round must lower the RMSE by this.
_SAME, _FALLS = 0.01, 1e-3
# Rows that show what gravity and effects leave at best.
_ROWS = 1500


@dataclass(frozen=True, eq=False)
class EffectFit:
    """
    The model with its effects, how gravity was estimated, and the RMSE of its prediction.

    `dynamics` says whether rigid-body dynamics was a nuisance term, and `left` in N·m is the RMSE
    of all joints beside it.
    """

    model: GravityModel
    estimate: Estimate
    rmse: FloatArray
    dynamics: bool
    left: float


def fit_with_terms(motion: Motion, rows: IntArray, model: GravityModel, terms: Sequence[Term],
                   kept: tuple[AppliedEffect, ...], options: FitOptions,
                   known: FloatArray | None = None, warm: bool = False,
                   spared: frozenset[tuple[str, int]] = frozenset()) -> EffectFit:
    """
    Return gravity and effects, fitted together to some rows of a motion.

    :param motion: of all samples, because some columns look back.
    :param rows: the samples (R,) to fit.
    :param model: the gravity to begin with; its joints are those of the motion.
    :param kept: effects that stay as they are.
    :param known: axes (N, 3, 3) of a chain that need no search.
    :param warm: whether the search for a chain starts from the model's and nowhere else.
    :param spared: nuisance terms that are not fitted, as kind and joint number.
    """
    if all(effect.pointwise for effect in (*(term.effect for term in terms),
                                           *map(installed, kept))):
        motion, rows = motion.at(rows), np.arange(len(rows))
    best: EffectFit | None = None
    hidden = _dynamics_beside(motion.at(rows), (*terms, *kept))
    if hidden:
        # It is made of axes and moments, which a chain alone has.
        options = FitOptions('chain', options.sparse)
    columns = _columns(motion, rows, (*terms, *hidden))
    for _ in range(_ROUNDS):
        found, beside, now = _once(motion, rows, model, (terms, hidden), kept, columns, options,
                                   known, warm, spared)
        if best is not None and found.left >= (1.0 - _FALLS) * best.left:
            break
        best, warm = found, True
        if _same(columns, now):
            break
        motion, model, columns = beside, found.model, now
    assert best is not None
    return best


def _dynamics_beside(motion: Motion, there: Sequence[Term | AppliedEffect]) -> tuple[Term, ...]:
    """
    Return rigid-body dynamics where it has to be a nuisance term of a motion, () elsewhere.

    :param there: the effects of the model.
    """
    effect = known_effect('rigid_body_dynamics')
    if (_names(there) & set(MOTION_EFFECTS) or not is_fast(motion.samples)
            or motion.serial_arm is None or effect.untestable(motion, 0) is not None):
        return ()
    return (Term(effect, None, effect.settings(motion, 0)[0]),)


def _axes_of_motion(model: GravityModel, there: Sequence[Term | AppliedEffect],
                    known: FloatArray | None) -> Geometry | None:
    """Return the axes (N, 3, 3) as they are known, if no effect describes the torque of motion."""
    if known is None or model.geometry is None or _names(there) & set(MOTION_EFFECTS):
        return None
    return replace(model.geometry, rotations=known)


def _names(there: Sequence[Term | AppliedEffect]) -> set[str]:
    return {each.effect.name if isinstance(each, Term) else each.name for each in there}


def _once(motion: Motion, rows: IntArray, model: GravityModel,
          shown_and_hidden: tuple[Sequence[Term], Sequence[Term]],
          kept: tuple[AppliedEffect, ...], columns: FloatArray, options: FitOptions,
          known: FloatArray | None, warm: bool, spared: frozenset[tuple[str, int]]
          ) -> tuple[EffectFit, Motion, FloatArray]:
    """
    Return a fit, and the motion and the columns (K, R, N) beside the gravity found.

    :param shown_and_hidden: the effects of the model, and those that are nuisance terms.
    """
    shown, hidden = shown_and_hidden
    terms = (*shown, *hidden)
    part = motion.samples.select(rows)
    fixed = np.zeros(part.tau.shape)
    if kept:
        fixed = effect_torque(_having(model, kept, motion), motion.samples)[rows]
    cleaned = replace(part, tau=part.tau - fixed)
    means = condense(cleaned)
    few, dense = means.samples(cleaned), _condensed(means, columns)
    regression = build_regression(cleaned, qdd=motion.qdd[rows], effects=dense,
                                  means=means, excluded=spared | replaced_terms(motion, terms),
                                  usual=_usual(motion, terms, few, dense),
                                  geometry=_axes_of_motion(model, (*terms, *kept), known))
    estimate = estimate_gravity(regression, options, model, known, warm)
    gravity = replace(gravity_model(estimate, part), history=model.history,
                      provenance=model.provenance, geometry=model.geometry)
    beside = motion.with_model(gravity)
    now = _columns(beside, rows, terms)
    if not _same(columns, now) and _symbols(motion, terms) == _symbols(beside, terms):
        # Beside the gravity that was found, effects that are made of it have other columns.
        dense = _condensed(means, now)
        usual = _usual(beside, terms, few, dense)
        estimate = replace(estimate, effects=_again(estimate, gravity, dense, usual))
        columns = now
    effects = of_gravity(gravity, motion, (*kept, *_applied(motion, shown, estimate)))
    made = _having(gravity, effects, motion)
    left = motion.samples.tau[rows] - predict_on(made, motion, rows)
    rmse = np.sqrt((left ** 2).mean(axis=0))
    n = len(columns) - sum(len(term.coefficients(motion)) for term in hidden)
    left = left - np.tensordot(estimate.effects[n:], columns[n:], axes=1)
    # The unit is the same in each round: one number for all joints.
    total = float(np.sqrt((left ** 2).mean()))
    return EffectFit(replace(made, noise=rmse), estimate, rmse, bool(hidden), total), beside, now


def _condensed(means: Condensation, columns: FloatArray) -> FloatArray | None:
    """Return columns (K, R, N) of condensed samples, (K, N, m); None if there are none."""
    return np.stack([means.mean(column) for column in columns]).transpose(0, 2, 1) \
        if len(columns) else None


def _again(estimate: Estimate, gravity: GravityModel, columns: FloatArray | None,
           usual: FloatArray | None) -> FloatArray:
    """Return the coefficients (K,) of other columns (K, N, m) beside the gravity found."""
    regression = replace(estimate.regression, effects=columns, usual=usual)
    beside = regression.beside()
    weights = regression.row_weights(estimate.choice.estimate.residual()).T
    left = regression.samples.tau - gravity.predict(regression.samples.q)
    found = WeightedNuisance(beside.columns, weights, beside.spread)
    return found.coefficients(weights * left.T)[:regression.n_effects]


def replaced_terms(motion: Motion, terms: Sequence[Term]) -> frozenset[tuple[str, int]]:
    """Return the nuisance terms that effects take the place of, as kind and joint number."""
    names = motion.samples.names
    found = set()
    for term in terms:
        kind = _REPLACED.get(term.effect.name)
        if kind is not None:
            found |= {(kind, n) for n, name in enumerate(names) if term.joint in (None, name)}
    return frozenset(found)


def _columns(motion: Motion, rows: IntArray, terms: Sequence[Term]) -> FloatArray:
    """Return the columns (K, R, N) of all terms at some rows."""
    names, n = motion.samples.names, motion.samples.n_joints
    parts = [np.zeros((0, len(rows), n))]
    for term in terms:
        joint = term.place(names)
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


def _usual(motion: Motion, terms: Sequence[Term], samples: JointSamples,
           columns: FloatArray | None) -> FloatArray | None:
    """
    Return the spread of the terms' coefficients before any data (K,), per N·m of noise.

    :param samples: those that are fitted, M of them.
    :param columns: (K, N, M), of the terms.
    """
    parts, known = [np.zeros(0)], False
    for term in terms:
        usual = term.effect.spread(motion, term.place(motion.samples.names), term.setting)
        count = len(term.coefficients(motion))
        parts.append(np.full(count, np.inf) if usual is None else usual)
        known = known or usual is not None
    if not known or columns is None:
        return None
    noise = np.sqrt(samples_per_observation(samples)) * _left(motion, samples, columns)
    lengths = np.sqrt((columns ** 2).sum(axis=(1, 2)))
    weighted = np.sqrt(((columns / noise[:, None]) ** 2).sum(axis=(1, 2)))
    # What this motion does not show has no length, and stays free.
    shown = lengths > 0.0
    return np.where(shown, np.concatenate(parts) * weighted / np.where(shown, lengths, 1.0),
                    np.inf)


def _left(motion: Motion, samples: JointSamples, columns: FloatArray) -> FloatArray:
    """Return what gravity and columns (K, N, M) leave of each joint at best (N,) in N·m."""
    assert motion.model is not None
    part = evenly_picked(samples.n_samples, _ROWS)
    q = samples.q[part]
    left = samples.tau[part] - motion.model.predict(q)
    flat = columns[:, :, part].transpose(2, 1, 0).reshape(left.size, -1)
    if motion.serial_arm is not None:
        # Gravity changes beside the effects.
        gravity = motion.serial_arm.jacobian(q).transpose(2, 1, 0)
        flat = np.hstack([flat, gravity.reshape(left.size, -1)])
    size = np.maximum(np.sqrt((flat ** 2).mean(axis=0)), 1e-300)
    x = lstsq(flat / size, left.ravel(), rcond=1e-9)
    std = (left - ((flat / size) @ x).reshape(left.shape)).std(axis=0)
    return np.asarray(np.maximum(std, 1e-3 * max(float(std.max()), 1e-9)))


def _applied(motion: Motion, terms: Sequence[Term], estimate: Estimate) -> list[AppliedEffect]:
    """Return the terms with their coefficients and 95 % intervals."""
    if not terms:
        return []
    std, quantile = clustered_std(estimate)
    found, first = [], 0
    for term in terms:
        coefficients = term.coefficients(motion)
        values = {}
        for k, coefficient in enumerate(coefficients, first):
            x, half = float(estimate.effects[k]), float(quantile * std[k])
            values[coefficient.symbol] = Value(x, coefficient.unit, (x - half, x + half))
        found.append(AppliedEffect(term.effect.name, term.joint, dict(term.setting), values))
        first += len(coefficients)
    return found


def of_gravity(gravity: GravityModel, motion: Motion,
               effects: tuple[AppliedEffect, ...]) -> tuple[AppliedEffect, ...]:
    """
    Return effects with the coefficients that they have beside another gravity.

    Some are shares of parts of gravity. What a model lacks has none, and a new part has share 0.
    """
    if all(installed(applied).has_fixed_coefficients for applied in effects):
        return effects
    beside = motion.with_model(gravity)
    found = []
    for applied in effects:
        joint = 0 if applied.joint is None else motion.samples.names.index(applied.joint)
        symbols = installed(applied).coefficients_of(beside, joint, applied.setting)
        found.append(replace(applied, coefficients={
            c.symbol: applied.coefficients.get(c.symbol, Value(0.0, c.unit, (0.0, 0.0)))
            for c in symbols}))
    return tuple(found)


def _having(model: GravityModel, effects: tuple[AppliedEffect, ...],
            motion: Motion) -> GravityModel:
    return replace(model, applied=Applied(effects, direction_of(motion)))


def _same(one: FloatArray, other: FloatArray) -> bool:
    return one.shape == other.shape and bool(
        np.linalg.norm(one - other) <= _SAME * max(float(np.linalg.norm(other)), 1e-300))
