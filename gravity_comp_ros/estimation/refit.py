"""
Add effects to a model: gravity and effects are refitted together, and judged on held-out data.

Before and after are the held-out errors of two refits to the same samples and folds, without
and with the new effects, so that what falls is due to the effects and not to the refit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.effects.effect import Motion
from gravity_comp_ros.effects.motion import build_motion, gravity_gradient
from gravity_comp_ros.effects.predict import direction_of, effect_torque, installed
from gravity_comp_ros.effects.request import Request
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.estimation.base_level import levelled
from gravity_comp_ros.estimation.gravity_step import moved, step_size
from gravity_comp_ros.estimation.refit_result import chance, held_out, Refit
from gravity_comp_ros.estimation.refit_system import System
from gravity_comp_ros.estimation.refit_terms import choose_setting, RefitProblem, Term
from gravity_comp_ros.evaluation.blocks import Blocks, cut
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
import numpy as np
from scipy import special

Progress = Callable[[str, float], None]

_MOST_ROWS = 20000
_ROUNDS = 4
# N·m relative to the noise: a change of the prediction that is none.
_SETTLED = 0.01
# What these families add shows in fast motion; the others are as plain in slow motion, where
# what they lack (inertia above all) does not bend gravity.
_FAST = ('dynamics', 'timing')
_ENOUGH_SLOW = 0.2
_TILT = 'base_tilt'


@dataclass(frozen=True)
class RefitOptions:
    """
    Which samples are fitted: those below `slow` rad/s, None for all.

    Unless `force` is set, all are fitted as well if slow ones are few, or if the effects need
    fast motion.
    """

    slow: float | None = 0.15
    force: bool = False


def refit(samples: JointSamples, model: GravityModel, wanted: Sequence[Request],
          options: RefitOptions = RefitOptions(), use: BoolArray | None = None,
          progress: Progress | None = None) -> Refit:
    """
    Return the model with the wanted effects, refitted as a whole to the samples.

    :param samples: as recorded, fast motion and all, because accelerations and friction with a
        memory need what lies between.
    :param use: which samples (M,) may be fitted; None for all.
    :raises DataError: if an effect is there already or cannot be seen, or samples are too few.
    :raises ModelMismatchError: if the samples lack a joint of the model, or the model has an
        effect that is not installed here.
    """
    tell = progress or (lambda word, share: None)
    samples = samples.joints(model.joints)
    tell('motion', 0.0)
    base = _level(samples, model, wanted)
    motion = build_motion(samples, base)
    new, skipped = _new_terms(motion, model, wanted)
    if wanted and not new:
        raise DataError('; '.join(f'{name}: {why}' for name, why in skipped.items()))
    old, kept = _old_terms(motion, model)
    work, all_speeds = _workplace(motion, base, kept, (*old, *new), use, options)
    start = work if base is model else work.at(build_motion(samples, model), model, model)
    tell('settings', 0.2)
    settled: list[tuple[Term, ...]] = [tuple(old)] * (work.n_folds + 1)
    for k, term in enumerate(new):
        chosen = choose_setting(work, settled, term)
        settled = [(*terms, one) for terms, one in zip(settled, chosen)]
        tell('settings', 0.2 + 0.4 * (k + 1) / len(new))
    tell('refit', 0.6)
    work.sigma = start.sigma = _spread(work.system(settled[-1]))
    work = _rounds(work, settled[-1])
    made, blocks = _with_effects(work, settled[-1], kept)
    senseless = _implausible(work, made, settled[-1])
    optional = {r.target for r in wanted if not r.named} & set(senseless)
    if optional and len(optional) < len(new):
        rest = [r for r in wanted if r.target not in optional]
        again = refit(samples, model, rest, options, use, progress)
        left_out = {name: senseless[name] for name in sorted(optional)}
        return replace(again, skipped={**again.skipped, **left_out})
    tell('held-out error', 0.8)
    errors = [start.system(tuple(old)).left_out_residual(), _left_out(work, settled)]
    result = Refit(made, tuple(term.target for term in new), held_out(work, *errors),
                   chance(work, blocks, *errors) if new else 1.0, len(work.rows), all_speeds,
                   skipped, senseless, tuple(effect.target for effect in kept))
    tell('held-out error', 1.0)
    return result


def _level(samples: JointSamples, model: GravityModel,
           wanted: Sequence[Request]) -> GravityModel:
    """Return the model to add to: a tilt needs one that does not imitate it by itself."""
    if not any(request.effect.name == _TILT for request in wanted) or model.energy is None:
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
        reason = ('it is in the model already; `gravity_comp add --undo` takes the last one back'
                  if model.applied.has(request.effect.name, request.joint)
                  else request.effect.untestable(motion, place))
        if reason is None and not request.effect.settings(motion, place):
            reason = 'this motion does not reach it'
        if reason is None:
            terms.append(Term(request.effect, request.joint, {}))
            continue
        if request.named:
            raise DataError(f'{request.target} cannot be added: {reason}')
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


def _workplace(motion: Motion, model: GravityModel, kept: tuple[AppliedEffect, ...],
               terms: Sequence[Term], use: BoolArray | None,
               options: RefitOptions) -> tuple[RefitProblem, bool]:
    samples = motion.samples
    allowed = np.ones(samples.n_samples, dtype=bool) if use is None else use
    rows, all_speeds = np.flatnonzero(allowed), True
    needs_fast = any(t.effect.family in _FAST for t in terms)
    if options.slow is not None and (options.force or not needs_fast):
        slow = allowed & (np.abs(samples.qd) <= options.slow).all(axis=1)
        if options.force or slow.sum() >= _ENOUGH_SLOW * max(len(rows), 1):
            all_speeds, rows = bool(slow.sum() == len(rows)), np.flatnonzero(slow)
    rows = rows[::-(-max(len(rows), 1) // _MOST_ROWS)]
    fixed = np.zeros_like(samples.q)
    if kept:
        fixed = effect_torque(replace(model, applied=replace(model.applied, effects=kept)),
                              samples)
    rest = (samples.tau - motion.gravity - fixed)[rows]
    blocks = cut(samples.select(rows), rest)
    work = RefitProblem(motion, model, model, rows, _folds(blocks), np.ones(samples.n_joints),
                        fixed[rows])
    work.sigma = _spread(work.system(tuple(t for t in terms if t.old)))
    return work, all_speeds


def _folds(blocks: Blocks) -> IntArray:
    return np.repeat(blocks.fold, np.diff(blocks.starts))


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


def _rounds(work: RefitProblem, terms: tuple[Term, ...]) -> RefitProblem:
    """Refit until columns that are made of gravity belong to the gravity that is found."""
    k, q = step_size(work.model), work.motion.samples.q
    for _ in range(_ROUNDS):
        x = work.system(terms).solve()
        model = moved(work.model, x[:k], _kept_covariance(work.model, k))
        gravity = model.predict(q)
        change = (gravity - work.motion.gravity)[work.rows] / work.sigma
        if float(np.sqrt((change ** 2).mean())) < _SETTLED:
            break
        motion = replace(work.motion, gravity=gravity, gradient=gravity_gradient(model, q),
                         model=model)
        work = work.at(motion, model, work.origin)
    return work


def _kept_covariance(model: GravityModel, size: int) -> FloatArray:
    """Return the covariance (K, K) on the way; that of a chain tells which angles are right."""
    if model.chain is None or model.uncertainty is None:
        return np.zeros((size, size))
    return model.uncertainty.covariance


def _left_out(work: RefitProblem, settled: list[tuple[Term, ...]]) -> FloatArray:
    """Return held-out residuals (R, N); the settings were chosen without the fold as well."""
    out = np.empty_like(work.fixed)
    residuals: dict[object, FloatArray] = {}
    for fold, terms in enumerate(settled[:-1]):
        key = tuple(term.key for term in terms)
        if key not in residuals:
            residuals[key] = work.system(terms).left_out_residual()
        rows = work.fold == fold
        out[rows] = residuals[key][rows]
    return out


def _with_effects(work: RefitProblem, terms: tuple[Term, ...],
                  kept: tuple[AppliedEffect, ...]) -> tuple[GravityModel, Blocks]:
    """Return the refitted model, and the blocks that its residual falls into."""
    system = work.system(terms)
    x = system.solve()
    rest = system.residual(x)
    samples = work.motion.samples.select(work.rows)
    blocks = cut(samples, rest)
    covariance = system.covariance(blocks)
    half = (special.stdtrit(max(blocks.count - 1, 2), 0.975)
            * np.sqrt(np.maximum(np.diag(covariance), 0.0)))
    k = step_size(work.model)
    effects, first = list(kept), k
    for term in terms:
        symbols = work.symbols(term)
        own = slice(first, first + len(symbols))
        effects.append(AppliedEffect(
            term.effect.name, term.joint, dict(term.setting),
            _values(work, term, x[own], half[own])))
        first += len(symbols)
    model = moved(work.model, x[:k], covariance[:k, :k])
    coverage = Coverage(samples.q.min(axis=0), samples.q.max(axis=0), samples.n_samples,
                        len(np.unique(samples.runs)))
    applied = Applied(tuple(effects), direction_of(work.motion))
    return replace(model, noise=np.sqrt((rest ** 2).mean(axis=0)), coverage=coverage,
                   applied=applied, history=work.origin.history), blocks


def _values(work: RefitProblem, term: Term, x: FloatArray, half: FloatArray) -> dict[str, Value]:
    coefficients = term.effect.coefficients_of(work.motion, work.place(term), term.setting)
    return {c.symbol: Value(float(v), c.unit, (float(v - h), float(v + h)))
            for c, v, h in zip(coefficients, x, half)}


def _implausible(work: RefitProblem, model: GravityModel, terms: Sequence[Term]) -> dict[str, str]:
    """Return which new effects came out with values that physics does not allow, and why."""
    found = {}
    for term in terms:
        applied = next(e for e in model.applied.effects if e.target == term.target)
        values = np.array([c.value for c in applied.coefficients.values()])
        reason = term.effect.implausible(values, term.setting, work.motion, work.place(term))
        if reason and term.old is None:
            found[term.target] = reason
    return found
