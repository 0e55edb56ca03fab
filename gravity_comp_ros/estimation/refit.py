"""
Refit of a model with added effects, evaluated on held-out data.

Gravity is selected again, jointly with the effects, as in a new fit: features that had absorbed an
effect disappear when the effect is added. The errors before and after are held-out errors of two
refits to the same folds, without and with the new effects.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import (
    BoolArray, evenly_picked, FloatArray, IntArray, JointSamples)
from gravity_comp_ros.effects.motion import build_motion, Motion
from gravity_comp_ros.effects.predict import (
    effect_torque, installed, predict_on, predict_torque)
from gravity_comp_ros.effects.request import Request
from gravity_comp_ros.errors import DataError, FitError, Hint
from gravity_comp_ros.estimation.chain_estimate import ChainEstimate
from gravity_comp_ros.estimation.effect_fit import (
    EffectFit, fit_with_terms, replaced_terms)
from gravity_comp_ros.estimation.fit import CHOICES, fit, FitOptions
from gravity_comp_ros.estimation.refit_result import held_out_errors, p_value, Refit
from gravity_comp_ros.estimation.refit_system import System
from gravity_comp_ros.estimation.refit_terms import choose_setting, RefitProblem, Term
from gravity_comp_ros.evaluation.blocks import Blocks, cut
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.base_level import levelled
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.nuisance import UNITS
from gravity_comp_ros.models.sparse.sparse_problem import SparseOptions
import numpy as np

Progress = Callable[[str, float], None]

# Maximum number of samples of the motion, evenly picked: an hour at 100 Hz becomes one at 11 Hz.
_MAX_SAMPLES = 40000
_MAX_ROWS = 10000
_MAX_FOLDS = 4
# Maximum factor on a joint's RMSE after a refit, and maximum increase as a share of the arm's
# largest torque: an offset that gravity had absorbed is no longer predicted.
_MAX_FACTOR, _MAX_INCREASE = 1.1, 0.1
# Effects whose coefficients belong to a run or to the time within it.
_BETWEEN_RUNS = ('payload_change', 'torque_drift', 'friction_drift')
# Minimum share of slow samples for a fit to these alone. Effects that need no speed are as
# identifiable in slow motion, in which unmodelled torque (mainly inertia) disturbs gravity less.
_MIN_SLOW_SHARE = 0.2
_TILT, _DYNAMICS = 'base_tilt', 'rigid_body_dynamics'


@dataclass(frozen=True)
class RefitOptions:
    """
    Options of a refit: only samples below `slow` rad/s are fitted, None for all.

    Unless `force` is set, all are fitted if slow ones are few, or if the effects require fast
    motion.
    """

    slow: float | None = 0.15
    force: bool = False

    @classmethod
    def chosen(cls, all_samples: bool, max_speed: float | None = None) -> RefitOptions:
        """Return the options for all samples, or for those below a limit in rad/s."""
        if all_samples:
            return cls(slow=None)
        return cls() if max_speed is None else cls(max_speed, force=True)


def refit(samples: JointSamples, model: GravityModel, effects: Sequence[Request],
          options: RefitOptions = RefitOptions(), use: BoolArray | None = None,
          progress: Progress | None = None) -> Refit:
    """
    Return the model with the wanted effects; gravity is selected again, jointly with them.

    :param samples: as recorded, fast motion included, because accelerations and friction with
        memory depend on the samples in between.
    :param use: which samples (M,) may be fitted; None for all.
    :raises DataError: if an effect is in the model already or not identifiable, or samples are
        too few.
    :raises FitError: if the result predicts the samples worse than the model before.
    :raises ModelMismatchError: if a joint of the model is not among the samples, or an effect
        of the model is not installed.
    """
    report = progress or (lambda word, share: None)
    samples = samples.joints(model.joints)
    picked = evenly_picked(samples.n_samples, _MAX_SAMPLES)
    samples, use = samples.select(picked), None if use is None else use[picked]
    report('motion', 0.0)
    effects, left_out = _without_tilt(model, effects)
    base = _base(samples, model, effects)
    motion = build_motion(samples, base)
    new, skipped = _new_terms(motion, model, effects)
    skipped.update(left_out)
    if effects and not new:
        raise DataError('; '.join(f'{name}: {why}' for name, why in skipped.items()))
    old, kept = _old_terms(motion, model)
    work, all_speeds = _problem(motion, base, kept, (*old, *new), use, options)
    chosen = _choose_settings(work, old, new, report)
    report('refit', 0.4)
    fit_options, known = _formulation(base, chosen[-1])
    fitted = fit_with_terms(motion, work.rows, base, chosen[-1], kept, fit_options, known)
    implausible = _implausible(work, fitted.model, chosen[-1])
    optional = {r.target for r in effects if not r.named} & set(implausible)
    if optional and len(optional) < len(new):
        rest = [r for r in effects if r.target not in optional]
        result = refit(samples, model, rest, options, use, progress)
        unphysical = {name: implausible[name] for name in sorted(optional)}
        return replace(result, skipped={**result.skipped, **left_out, **unphysical})
    report('held-out error', 0.6)
    residuals = _held_out_residuals(work, fitted, old, chosen, kept, known, report)
    blocks = cut(samples.select(work.rows), residuals[1])
    result = Refit(fitted.model, tuple(term.target for term in new),
                   held_out_errors(work, *residuals),
                   p_value(work, blocks, *residuals) if new else 1.0, len(work.rows), all_speeds,
                   skipped, implausible, tuple(effect.target for effect in kept))
    if new:
        _check_not_worse(model, fitted.model, motion, work.rows)
    report('held-out error', 1.0)
    return result


def _choose_settings(work: RefitProblem, old: list[Term], new: list[Term],
                     report: Progress) -> list[tuple[Term, ...]]:
    """Return the old terms, and the new ones with nonlinear parameters, for each fit."""
    report('settings', 0.2)
    chosen: list[tuple[Term, ...]] = [tuple(old)] * (work.n_folds + 1)
    for k, term in enumerate(new):
        best = choose_setting(work, chosen, term)
        chosen = [(*terms, one) for terms, one in zip(chosen, best)]
        report('settings', 0.2 + 0.2 * (k + 1) / len(new))
    return chosen


def _formulation(model: GravityModel, terms: Sequence[Term]
                 ) -> tuple[FitOptions, FloatArray | None]:
    """
    Return the requested formulation of the model's fit, and its known axes (N, 3, 3).

    Rigid-body dynamics requires axes and moments, which only a chain has.
    """
    report = model.provenance.get('report') or {}
    formulation = (model.provenance.get('options') or {}).get('formulation', 'auto')
    if formulation not in CHOICES:
        formulation = 'auto'
    known = None
    if model.chain is not None and (report.get('chain') or {}).get('known_axes'):
        known, formulation = model.chain.axes, 'chain'
    if any(term.effect.name == _DYNAMICS for term in terms):
        formulation = 'chain'
    return FitOptions(formulation), known


def _held_out_residuals(work: RefitProblem, fitted: EffectFit, old: list[Term],
                        chosen: list[tuple[Term, ...]], kept: tuple[AppliedEffect, ...],
                        known: FloatArray | None,
                        report: Progress) -> tuple[FloatArray, FloatArray]:
    """
    Return held-out residuals (R, N) in N·m without and with the new effects.

    Gravity, nonlinear parameters and coefficients for each fold are fitted to the other folds.
    """
    gravity = fitted.estimate.choice.estimate
    sparse = SparseOptions() if isinstance(gravity, ChainEstimate) else SparseOptions(
        inflation=gravity.fits[0].inflation)
    options = FitOptions(fitted.model.formulation, sparse)
    samples, rows = work.motion.samples, work.rows
    excluded = _absent_terms(fitted, work.motion, chosen[-1])
    before, after = (np.empty((len(rows), samples.n_joints)) for _ in range(2))
    for fold, terms in enumerate(chosen[:-1]):
        test = work.fold == fold
        for out, used in ((before, tuple(old)), (after, terms)):
            if out is after and terms == tuple(old):
                out[test] = before[test]
                continue
            without = fit_with_terms(work.motion, rows[~test], fitted.model, used, kept, options,
                                     known, warm=True, excluded=excluded)
            out[test] = samples.tau[rows[test]] - predict_on(without.model, work.motion,
                                                             rows[test])
        report('held-out error', 0.6 + 0.4 * (fold + 1) / work.n_folds)
    return before, after


def _absent_terms(fitted: EffectFit, motion: Motion,
                  terms: Sequence[Term]) -> frozenset[tuple[str, int]]:
    """
    Return the nuisance terms that are not in the fit to all samples, as kind and joint number.

    With fewer samples an offset is less distinguishable from a tilt of the base, and friction
    from an error of the axes. Terms that an effect replaces are not among them: they are fitted
    without that effect.
    """
    nuisance = fitted.estimate.choice.estimate.regression.nuisance
    every = {(kind, n) for kind in UNITS for n in range(motion.samples.n_joints)}
    return frozenset(every - {(c.kind, c.joint) for c in nuisance.columns}
                     - replaced_terms(motion, terms))


def _check_not_worse(before: GravityModel, after: GravityModel, motion: Motion,
                     rows: IntArray) -> None:
    """
    Check that the model predicts its own data no worse than the one before.

    :raises FitError: if it does.
    """
    tau = motion.samples.tau[rows]
    old_rmse, rmse = (np.sqrt(((tau - predicted) ** 2).mean(axis=0)) for predicted in (
        predict_torque(before, motion.samples)[rows], predict_on(after, motion, rows)))
    allowed = _MAX_INCREASE * np.sqrt((tau ** 2).mean(axis=0)).max()
    worse = np.flatnonzero(rmse > _MAX_FACTOR * old_rmse + allowed)
    if worse.size:
        n = int(worse[np.argmax(rmse[worse] - old_rmse[worse])])
        raise FitError(f'the model with these effects predicts its own data worse than the one '
                       f'before: joint {before.joints[n]} {old_rmse[n]:.3g} N·m before, '
                       f'{rmse[n]:.3g} N·m after. Nothing is changed; record more motion, or add '
                       f'fewer effects')


def _without_tilt(model: GravityModel, effects: Sequence[Request]
                  ) -> tuple[Sequence[Request], dict[str, str]]:
    """
    Return the effects without a base tilt if gravity is a chain, and the reason for omitting it.

    :raises DataError: if nothing else is wanted.
    """
    rest = [request for request in effects if request.effect.name != _TILT]
    is_chain = model.chain is not None or (
        model.geometry is None and any(request.effect.name == _DYNAMICS for request in rest))
    if not is_chain or len(rest) == len(effects):
        return effects, {}
    if not rest:
        raise DataError(f'{_TILT} cannot be added: the first axis of a chain includes the tilt '
                        f'of its base. Fit gravity again, with all recordings that show the tilt')
    return rest, {_TILT: 'the first axis of a chain includes the tilt of its base, and gravity is '
                         'fitted again'}


def _base(samples: JointSamples, model: GravityModel,
          effects: Sequence[Request]) -> GravityModel:
    """
    Return the model to add to.

    Rigid-body dynamics requires the axes of a chain; a base tilt requires a level model.
    """
    names = {request.effect.name for request in effects}
    if _DYNAMICS in names and model.chain is None and model.geometry is None:
        chain = fit(samples, FitOptions('chain')).model
        model = replace(chain, applied=model.applied, history=model.history,
                        provenance=model.provenance)
    return levelled(model, samples.q) if _TILT in names and model.energy is not None else model


def _new_terms(motion: Motion, model: GravityModel,
               effects: Sequence[Request]) -> tuple[list[Term], dict[str, str]]:
    """Return the identifiable wanted effects, and the reasons for omitting the others."""
    terms, skipped = [], {}
    for request in effects:
        joint = 0 if request.joint is None else model.joints.index(request.joint)
        present = model.applied.has(request.effect.name, request.joint)
        reason = ('it is in the model already' if present
                  else request.effect.untestable(motion, joint))
        if reason is None and not request.effect.settings(motion, joint):
            reason = 'this motion does not reach it'
        if reason is None:
            terms.append(Term(request.effect, request.joint, {}))
            continue
        if request.named:
            raise DataError(f'{request.target} cannot be added: {reason}',
                            Hint.IN_MODEL if present else None)
        skipped[request.target] = reason
    return terms, skipped


def _old_terms(motion: Motion, model: GravityModel
               ) -> tuple[list[Term], tuple[AppliedEffect, ...]]:
    """Return the effects to refit, and those that this motion does not excite."""
    terms, kept = [], []
    for applied in model.applied.effects:
        effect = installed(applied)
        joint = 0 if applied.joint is None else model.joints.index(applied.joint)
        symbols = {c.symbol for c in effect.coefficients_of(motion, joint, applied.setting)}
        if effect.untestable(motion, joint) or symbols != set(applied.coefficients):
            kept.append(applied)
        else:
            terms.append(Term(effect, applied.joint, applied.setting, applied))
    return terms, tuple(kept)


def _problem(motion: Motion, model: GravityModel, kept: tuple[AppliedEffect, ...],
             terms: Sequence[Term], use: BoolArray | None,
             options: RefitOptions) -> tuple[RefitProblem, bool]:
    """Return the problem of a refit, and whether samples of all speeds are fitted."""
    samples = motion.samples
    allowed = np.ones(samples.n_samples, dtype=bool) if use is None else use
    rows, all_speeds = np.flatnonzero(allowed), True
    needs_speed = any(t.effect.needs_speed for t in terms)
    if options.slow is not None and (options.force or not needs_speed):
        slow = allowed & (np.abs(samples.qd) <= options.slow).all(axis=1)
        if options.force or slow.sum() >= _MIN_SLOW_SHARE * max(len(rows), 1):
            all_speeds, rows = bool(slow.sum() == len(rows)), np.flatnonzero(slow)
    rows = rows[evenly_picked(len(rows), _MAX_ROWS)]
    fixed = np.zeros_like(samples.q)
    if kept:
        fixed = effect_torque(replace(model, applied=replace(model.applied, effects=kept)),
                              samples)
    residual = (samples.tau - motion.gravity - fixed)[rows]
    blocks = cut(samples.select(rows), residual)
    fold = _folds(samples.runs[rows], blocks, terms)
    work = RefitProblem(motion, model, rows, fold, np.ones(samples.n_joints), fixed[rows])
    work.sigma = _noise_std(work.system(tuple(t for t in terms if t.old)))
    return work, all_speeds


def _folds(runs: IntArray, blocks: Blocks, terms: Sequence[Term]) -> IntArray:
    """
    Return the fold of each row (R,): whole runs if there are several, else blocks of time.

    Effects that change from run to run cannot be predicted for a held-out run.
    """
    present = np.unique(runs)
    if len(present) < 2 or any(term.effect.name in _BETWEEN_RUNS for term in terms):
        return np.repeat(blocks.fold, np.diff(blocks.starts)) % _MAX_FOLDS
    fold = np.zeros(len(runs), dtype=np.int64)
    for number, group in enumerate(np.array_split(present, min(len(present), _MAX_FOLDS))):
        fold[np.isin(runs, group)] = number
    return fold


def _noise_std(system: System) -> FloatArray:
    """Return each joint's noise (N,), never 0."""
    for _ in range(2):
        residual = system.residual(system.solve())
        sigma = np.sqrt((residual ** 2).mean(axis=0))
        floor = 1e-6 * max(float(np.abs(system.y).max()), 1e-9)
        sigma = np.maximum(sigma, floor)
        system = System(system.parts, system.y, sigma, system.prior, system.fold,
                        int(system.fold.max()) + 1)
    return sigma


def _implausible(work: RefitProblem, model: GravityModel, terms: Sequence[Term]) -> dict[str, str]:
    """Return the new effects with coefficients that are not physical, and the reasons."""
    implausible = {}
    new = [term for term in terms if term.old is None]
    motion = work.motion.with_model(model) if new else work.motion
    for term in new:
        applied = next(e for e in model.applied.effects if e.target == term.target)
        values = np.array([c.value for c in applied.coefficients.values()])
        reason = term.effect.implausible(values, term.setting, motion, work.joint_index(term))
        if reason:
            implausible[term.target] = reason
    return implausible
