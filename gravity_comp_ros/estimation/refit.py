"""
Add effects to a model: gravity and effects are refitted together, and judged on held-out data.

Gravity is selected anew beside the effects, as in a fresh fit, so that terms that had imitated an
effect go when it comes. Before and after are held-out errors of two refits to the same folds,
without and with the new effects, each predicted by the models as they are.
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
from gravity_comp_ros.estimation.refit_result import chance, held_out, Refit
from gravity_comp_ros.estimation.refit_system import System
from gravity_comp_ros.estimation.refit_terms import choose_setting, RefitProblem, Term
from gravity_comp_ros.evaluation.blocks import Blocks, cut
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.base_level import levelled
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.nuisance import OFFSET
from gravity_comp_ros.models.sparse.sparse_problem import SparseOptions
import numpy as np

Progress = Callable[[str, float], None]

# Of longer recordings evenly picked samples serve: an hour at 100 Hz becomes one at 11 Hz.
_MOST_SAMPLES = 40000
_MOST_ROWS = 10000
_MOST_FOLDS = 4
# A refit may raise a joint's RMSE by this factor, and by this share of the arm's largest torque:
# an offset that gravity had imitated is no longer predicted.
_WORSE, _SHARE = 1.1, 0.1
# Effects whose coefficients belong to a run or to the time within it.
_BETWEEN_RUNS = ('payload_change', 'torque_drift', 'friction_drift')
# What needs no speed is as plain in slow motion, where what it lacks (inertia above all) does not
# bend gravity.
_ENOUGH_SLOW = 0.2
_TILT, _DYNAMICS = 'base_tilt', 'rigid_body_dynamics'


@dataclass(frozen=True)
class RefitOptions:
    """
    Which samples are fitted: those below `slow` rad/s, None for all.

    Unless `force` is set, all are fitted as well if slow ones are few, or if the effects need
    fast motion.
    """

    slow: float | None = 0.15
    force: bool = False

    @classmethod
    def chosen(cls, all_samples: bool, max_speed: float | None = None) -> RefitOptions:
        """Return the options by a user's choice: all samples, or those below a limit in rad/s."""
        if all_samples:
            return cls(slow=None)
        return cls() if max_speed is None else cls(max_speed, force=True)


def refit(samples: JointSamples, model: GravityModel, wanted: Sequence[Request],
          options: RefitOptions = RefitOptions(), use: BoolArray | None = None,
          progress: Progress | None = None) -> Refit:
    """
    Return the model with the wanted effects; gravity is selected anew beside them.

    :param samples: as recorded, fast motion and all, because accelerations and friction with a
        memory need what lies between.
    :param use: which samples (M,) may be fitted; None for all.
    :raises DataError: if an effect is there already or cannot be seen, or samples are too few.
    :raises FitError: if the result predicts the samples worse than the model before.
    :raises ModelMismatchError: if the samples lack a joint of the model, or the model has an
        effect that is not installed here.
    """
    tell = progress or (lambda word, share: None)
    samples = samples.joints(model.joints)
    picked = evenly_picked(samples.n_samples, _MOST_SAMPLES)
    samples, use = samples.select(picked), None if use is None else use[picked]
    tell('motion', 0.0)
    base = _base(samples, model, wanted)
    motion = build_motion(samples, base)
    new, skipped = _new_terms(motion, model, wanted)
    if wanted and not new:
        raise DataError('; '.join(f'{name}: {why}' for name, why in skipped.items()))
    old, kept = _old_terms(motion, model)
    work, all_speeds = _problem(motion, base, kept, (*old, *new), use, options)
    tell('settings', 0.2)
    settled: list[tuple[Term, ...]] = [tuple(old)] * (work.n_folds + 1)
    for k, term in enumerate(new):
        chosen = choose_setting(work, settled, term)
        settled = [(*terms, one) for terms, one in zip(settled, chosen)]
        tell('settings', 0.2 + 0.2 * (k + 1) / len(new))
    tell('refit', 0.4)
    how, known = _formulation(base, settled[-1])
    fitted = fit_with_terms(motion, work.rows, base, settled[-1], kept, how, known)
    made = fitted.model
    senseless = _implausible(work, made, settled[-1])
    optional = {r.target for r in wanted if not r.named} & set(senseless)
    if optional and len(optional) < len(new):
        rest = [r for r in wanted if r.target not in optional]
        again = refit(samples, model, rest, options, use, progress)
        left_out = {name: senseless[name] for name in sorted(optional)}
        return replace(again, skipped={**again.skipped, **left_out})
    tell('held-out error', 0.6)
    errors = _left_out(work, fitted, old, settled, kept, known, tell)
    blocks = cut(samples.select(work.rows), errors[1])
    result = Refit(made, tuple(term.target for term in new), held_out(work, *errors),
                   chance(work, blocks, *errors) if new else 1.0, len(work.rows), all_speeds,
                   skipped, senseless, tuple(effect.target for effect in kept))
    if new:
        _check_not_worse(model, made, motion, work.rows)
    tell('held-out error', 1.0)
    return result


def _formulation(model: GravityModel, terms: Sequence[Term]
                 ) -> tuple[FitOptions, FloatArray | None]:
    """
    Return how gravity is selected anew: as asked for when it was fitted, on the same axes.

    Rigid-body dynamics is made of axes and moments, which a chain alone has.
    """
    report = model.provenance.get('report') or {}
    asked = (model.provenance.get('options') or {}).get('formulation', 'auto')
    if asked not in CHOICES:
        asked = 'auto'
    known = None
    if model.chain is not None and (report.get('chain') or {}).get('known_axes'):
        known, asked = model.chain.axes, 'chain'
    if any(term.effect.name == _DYNAMICS for term in terms):
        asked = 'chain'
    return FitOptions(asked), known


def _left_out(work: RefitProblem, fitted: EffectFit, old: list[Term],
              settled: list[tuple[Term, ...]], kept: tuple[AppliedEffect, ...],
              known: FloatArray | None, tell: Progress) -> tuple[FloatArray, FloatArray]:
    """
    Return held-out residuals (R, N) in N·m without and with the new effects.

    Each fold is predicted by models that were fitted without it: gravity, nonlinear parameters
    and coefficients are those that the other folds give.
    """
    found = fitted.estimate.choice.estimate
    sparse = SparseOptions() if isinstance(found, ChainEstimate) else SparseOptions(
        inflation=found.fits[0].inflation)
    how = FitOptions(fitted.model.formulation, sparse)
    samples, rows = work.motion.samples, work.rows
    spared = _without_offset(fitted, work.motion, settled[-1])
    before, after = np.empty((len(rows), samples.n_joints)), np.empty(
        (len(rows), samples.n_joints))
    for fold, terms in enumerate(settled[:-1]):
        test = work.fold == fold
        for out, used in ((before, tuple(old)), (after, terms)):
            if out is after and terms == tuple(old):
                out[test] = before[test]
                continue
            without = fit_with_terms(work.motion, rows[~test], fitted.model, used, kept, how,
                                     known, warm=True, spared=spared)
            out[test] = samples.tau[rows[test]] - predict_on(without.model, work.motion,
                                                             rows[test])
        tell('held-out error', 0.6 + 0.4 * (fold + 1) / work.n_folds)
    return before, after


def _without_offset(fitted: EffectFit, motion: Motion,
                    terms: Sequence[Term]) -> frozenset[tuple[str, int]]:
    """
    Return the offsets that the fit to all samples does without, as kind and joint number.

    Fewer samples tell a constant torque less well from a tilt of the base. An offset whose place
    an effect takes is fitted where that effect is not.
    """
    nuisance = fitted.estimate.choice.estimate.regression.nuisance
    every = {(OFFSET, n) for n in range(motion.samples.n_joints)}
    return frozenset(every - {(c.kind, c.joint) for c in nuisance.columns}
                     - replaced_terms(motion, terms))


def _check_not_worse(before: GravityModel, after: GravityModel, motion: Motion,
                     rows: IntArray) -> None:
    """
    Check that the model as it is predicts its own data no worse than the one before.

    :raises FitError: if it does.
    """
    tau = motion.samples.tau[rows]
    was, now = (np.sqrt(((tau - predicted) ** 2).mean(axis=0)) for predicted in (
        predict_torque(before, motion.samples)[rows], predict_on(after, motion, rows)))
    least = _SHARE * np.sqrt((tau ** 2).mean(axis=0)).max()
    worse = np.flatnonzero(now > _WORSE * was + least)
    if worse.size:
        n = int(worse[np.argmax(now[worse] - was[worse])])
        raise FitError(f'the model with these effects predicts its own data worse than the one '
                       f'before: joint {before.joints[n]} {was[n]:.3g} N·m before, {now[n]:.3g} '
                       f'N·m after. Nothing is changed; record more motion, or add fewer effects')


def _base(samples: JointSamples, model: GravityModel,
          wanted: Sequence[Request]) -> GravityModel:
    """
    Return the model to add to.

    Rigid-body dynamics needs the axes of a chain, and a tilt a model that does not imitate it.
    """
    names = {request.effect.name for request in wanted}
    if _DYNAMICS in names and model.chain is None and model.geometry is None:
        chain = fit(samples, FitOptions('chain')).model
        model = replace(chain, applied=model.applied, history=model.history,
                        provenance=model.provenance)
    if _TILT not in names or model.energy is None:
        return model
    if model.chain is not None:
        raise DataError(f'{_TILT} cannot be added: a chain holds the tilt of its base already, '
                        f'in its first axis')
    return levelled(model, samples.q)


def _new_terms(motion: Motion, model: GravityModel,
               wanted: Sequence[Request]) -> tuple[list[Term], dict[str, str]]:
    """Return the wanted effects that this motion shows, and why others are left out."""
    terms, skipped = [], {}
    for request in wanted:
        place = 0 if request.joint is None else model.joints.index(request.joint)
        there = model.applied.has(request.effect.name, request.joint)
        reason = ('it is in the model already' if there
                  else request.effect.untestable(motion, place))
        if reason is None and not request.effect.settings(motion, place):
            reason = 'this motion does not reach it'
        if reason is None:
            terms.append(Term(request.effect, request.joint, {}))
            continue
        if request.named:
            raise DataError(f'{request.target} cannot be added: {reason}',
                            Hint.IN_MODEL if there else None)
        skipped[request.target] = reason
    return terms, skipped


def _old_terms(motion: Motion, model: GravityModel
               ) -> tuple[list[Term], tuple[AppliedEffect, ...]]:
    """Return the effects to refit, and those that this motion does not show."""
    terms, kept = [], []
    for applied in model.applied.effects:
        effect = installed(applied)
        place = 0 if applied.joint is None else model.joints.index(applied.joint)
        symbols = {c.symbol for c in effect.coefficients_of(motion, place, applied.setting)}
        if effect.untestable(motion, place) or symbols != set(applied.coefficients):
            kept.append(applied)
        else:
            terms.append(Term(effect, applied.joint, applied.setting, applied))
    return terms, tuple(kept)


def _problem(motion: Motion, model: GravityModel, kept: tuple[AppliedEffect, ...],
             terms: Sequence[Term], use: BoolArray | None,
             options: RefitOptions) -> tuple[RefitProblem, bool]:
    samples = motion.samples
    allowed = np.ones(samples.n_samples, dtype=bool) if use is None else use
    rows, all_speeds = np.flatnonzero(allowed), True
    needs_speed = any(t.effect.needs_speed for t in terms)
    if options.slow is not None and (options.force or not needs_speed):
        slow = allowed & (np.abs(samples.qd) <= options.slow).all(axis=1)
        if options.force or slow.sum() >= _ENOUGH_SLOW * max(len(rows), 1):
            all_speeds, rows = bool(slow.sum() == len(rows)), np.flatnonzero(slow)
    rows = rows[evenly_picked(len(rows), _MOST_ROWS)]
    fixed = np.zeros_like(samples.q)
    if kept:
        fixed = effect_torque(replace(model, applied=replace(model.applied, effects=kept)),
                              samples)
    rest = (samples.tau - motion.gravity - fixed)[rows]
    blocks = cut(samples.select(rows), rest)
    fold = _folds(samples.runs[rows], blocks, terms)
    work = RefitProblem(motion, model, model, rows, fold, np.ones(samples.n_joints), fixed[rows])
    work.sigma = _spread(work.system(tuple(t for t in terms if t.old)))
    return work, all_speeds


def _folds(runs: IntArray, blocks: Blocks, terms: Sequence[Term]) -> IntArray:
    """
    Return the fold of each row (R,): whole runs where there are several, else blocks of time.

    Effects that change from run to run cannot be predicted of a run that was not fitted.
    """
    present = np.unique(runs)
    if len(present) < 2 or any(term.effect.name in _BETWEEN_RUNS for term in terms):
        return np.repeat(blocks.fold, np.diff(blocks.starts)) % _MOST_FOLDS
    fold = np.zeros(len(runs), dtype=np.int64)
    for number, group in enumerate(np.array_split(present, min(len(present), _MOST_FOLDS))):
        fold[np.isin(runs, group)] = number
    return fold


def _spread(system: System) -> FloatArray:
    """Return each joint's noise (N,), never 0."""
    for _ in range(2):
        rest = system.residual(system.solve())
        sigma = np.sqrt((rest ** 2).mean(axis=0))
        floor = 1e-6 * max(float(np.abs(system.y).max()), 1e-9)
        sigma = np.maximum(sigma, floor)
        system = System(system.parts, system.y, sigma, system.prior, system.fold,
                        int(system.fold.max()) + 1)
    return sigma


def _implausible(work: RefitProblem, model: GravityModel, terms: Sequence[Term]) -> dict[str, str]:
    """Return which new effects came out with values that physics does not allow, and why."""
    found = {}
    new = [term for term in terms if term.old is None]
    motion = work.motion.with_model(model) if new else work.motion
    for term in new:
        applied = next(e for e in model.applied.effects if e.target == term.target)
        values = np.array([c.value for c in applied.coefficients.values()])
        reason = term.effect.implausible(values, term.setting, motion, work.place(term))
        if reason:
            found[term.target] = reason
    return found
