"""Terms of a joint refit: effects with their nonlinear parameters, and their columns."""

from __future__ import annotations

from dataclasses import dataclass, field

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.effects.effect import Coefficients, Effect, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.estimation.gravity_step import Part, step_columns, step_scale
from gravity_comp_ros.estimation.refit_system import Prior, System
from gravity_comp_ros.models.applied_effects import AppliedEffect, target
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np


@dataclass(frozen=True)
class Term:
    """
    An effect on a joint (None: the whole arm) with its nonlinear parameters `setting`.

    `old` is the effect in the model before the refit, None for a new effect.
    """

    effect: Effect
    joint: str | None
    setting: Setting
    old: AppliedEffect | None = None

    @property
    def target(self) -> str:
        return target(self.effect.name, self.joint)

    @property
    def key(self) -> tuple[str, tuple[tuple[str, float], ...]]:
        """Return the identity of the term: target and nonlinear parameters."""
        return self.target, tuple(sorted(self.setting.items()))

    def joint_index(self, joints: tuple[str, ...]) -> int:
        """Return the joint number for the effect's functions, 0 for the whole arm."""
        return 0 if self.joint is None else joints.index(self.joint)

    def coefficients(self, motion: Motion) -> Coefficients:
        """Return the coefficients of the columns on a motion."""
        return self.effect.coefficients_of(motion, self.joint_index(motion.samples.names),
                                           self.setting)


@dataclass
class RefitProblem:
    """
    The data of a refit: motion, model, and the rows (R,) of the motion that are fitted.

    `fold` (R,) is the fold of each row, `sigma` (N,) the noise in N·m, and `fixed` (R, N) in N·m
    the torque of effects that keep their coefficients.
    """

    motion: Motion
    model: GravityModel
    rows: IntArray
    fold: IntArray
    sigma: FloatArray
    fixed: FloatArray
    _columns: dict[object, FloatArray] = field(default_factory=dict, init=False)
    _gravity: list[Part] | None = field(default=None, init=False)

    @property
    def n_folds(self) -> int:
        return int(self.fold.max()) + 1

    def joint_index(self, term: Term) -> int:
        """Return the joint number for the functions of a term's effect."""
        return term.joint_index(self.model.joints)

    def columns(self, term: Term) -> FloatArray:
        """Return a term's columns at the rows: (R, K), or (R, N, K) for effects of the arm."""
        if term.key not in self._columns:
            columns = term.effect.columns(self.motion, self.joint_index(term), term.setting)
            self._columns[term.key] = columns[self.rows]
        return self._columns[term.key]

    def system(self, terms: tuple[Term, ...], every: int = 1) -> System:
        """Return the least-squares problem of gravity and terms, on every `every`-th row."""
        if self._gravity is None:
            self._gravity = step_columns(self.model, self.motion.samples.q[self.rows])
        parts = [Part(p.unknowns, p.columns[::every]) for p in self._gravity]
        scale = step_scale(self.model)
        first = len(scale)
        priors = [Prior(1.0 / scale ** 2, np.zeros(first))]
        for term in terms:
            columns = self.columns(term)[::every]
            k = columns.shape[-1]
            own = first + np.arange(k)
            for n in range(len(parts)) if columns.ndim == 3 else [self.joint_index(term)]:
                of_joint = columns[:, n] if columns.ndim == 3 else columns
                parts[n] = Part(np.append(parts[n].unknowns, own),
                                np.column_stack([parts[n].columns, of_joint]))
            priors.append(self._prior(term, k))
            first += k
        rows = self.rows[::every]
        y = (self.motion.samples.tau[rows] - self.motion.gravity[rows]) - self.fixed[::every]
        return System(parts, y, self.sigma, Prior.joined(priors), self.fold[::every],
                      self.n_folds)

    def _prior(self, term: Term, k: int) -> Prior:
        """Return the prior of a term: that of its effect, or its old coefficients, or none."""
        std = term.effect.spread(self.motion, self.joint_index(term), term.setting)
        if std is not None:
            return Prior(std ** -2, np.zeros(k))
        if term.old is None:
            return Prior(np.zeros(k), np.zeros(k))
        values = np.array([term.old.coefficients[c.symbol].value
                           for c in term.coefficients(self.motion)])
        largest = max(float(np.abs(values).max()), 1e-9)
        return Prior(np.full(k, largest ** -2), values)


def choose_setting(work: RefitProblem, chosen: list[tuple[Term, ...]], term: Term,
                   max_rows: int = 4000) -> list[Term]:
    """
    Return the term with the best nonlinear parameters for each fit: one per fold, one to all.

    Nonlinear parameters are compared by the error on the samples of each fit, so that the choice
    is independent of the held-out fold.

    :param chosen: for each fit, the terms with chosen nonlinear parameters.
    """
    joint = work.joint_index(term)
    every = -(-len(work.rows) // max_rows)
    candidates = [Term(term.effect, term.joint, setting)
                  for setting in term.effect.settings(work.motion, joint)]
    if len(candidates) > 1:
        best = _best(work, chosen, candidates, every)
        finer = [Term(term.effect, term.joint, setting) for coarse in best
                 for setting in term.effect.refine(work.motion, joint, coarse.setting)]
        candidates = list({each.key: each for each in (*best, *finer)}.values())
    return _best(work, chosen, candidates, every)


def _best(work: RefitProblem, chosen: list[tuple[Term, ...]], candidates: list[Term],
          every: int) -> list[Term]:
    if len(candidates) == 1:
        return candidates * len(chosen)
    errors = np.empty((len(chosen), len(candidates)))
    for k, term in enumerate(candidates):
        systems: dict[object, System] = {}
        for fit, terms in enumerate(chosen):
            key = tuple(t.key for t in terms)
            if key not in systems:
                systems[key] = work.system((*terms, term), every)
            errors[fit, k] = systems[key].training_error(fit if fit < len(chosen) - 1 else -1)
    return [candidates[k] for k in errors.argmin(axis=1)]
