"""Effects in a joint refit: which ones, with which setting, and their columns."""

from __future__ import annotations

from dataclasses import dataclass, field

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.effects.effect import Coefficients, Effect, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.estimation.gravity_step import Part, step_columns, step_from, step_scale
from gravity_comp_ros.estimation.refit_system import Prior, System
from gravity_comp_ros.models.applied_effects import AppliedEffect, target
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np


@dataclass(frozen=True)
class Term:
    """
    An effect on a joint (None: the whole arm) with its setting.

    `old` is what the model had of it before, where the effect is not new.
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
        """Return what tells terms apart."""
        return self.target, tuple(sorted(self.setting.items()))

    def place(self, joints: tuple[str, ...]) -> int:
        """Return the joint number that the effect's functions are given."""
        return 0 if self.joint is None else joints.index(self.joint)

    def coefficients(self, motion: Motion) -> Coefficients:
        """Return what the columns on a motion are multiplied by."""
        return self.effect.coefficients_of(motion, self.place(motion.samples.names),
                                           self.setting)


@dataclass
class RefitProblem:
    """
    What systems are built from: motion, model, and the rows (R,) of the motion that are fitted.

    `origin` is the model that the refit started from, `sigma` (N,) the noise in N·m, `fold`
    (R,) the fold of each row, and `fixed` (R, N) in N·m the torque of effects that this
    recording does not show, which stays as it was.
    """

    motion: Motion
    model: GravityModel
    origin: GravityModel
    rows: IntArray
    fold: IntArray
    sigma: FloatArray
    fixed: FloatArray
    _columns: dict[object, FloatArray] = field(default_factory=dict, init=False)
    _gravity: list[Part] | None = field(default=None, init=False)

    @property
    def n_folds(self) -> int:
        return int(self.fold.max()) + 1

    def at(self, motion: Motion, model: GravityModel, origin: GravityModel) -> RefitProblem:
        """Return the same with another model of gravity."""
        return RefitProblem(motion, model, origin, self.rows, self.fold, self.sigma, self.fixed)

    def place(self, term: Term) -> int:
        """Return the joint number that an effect's functions are given."""
        return term.place(self.model.joints)

    def columns(self, term: Term) -> FloatArray:
        """Return a term's columns at the rows: (R, K), or (R, N, K) for effects of the arm."""
        if term.key not in self._columns:
            every = term.effect.columns(self.motion, self.place(term), term.setting)
            self._columns[term.key] = every[self.rows]
        return self._columns[term.key]

    def system(self, terms: tuple[Term, ...], every: int = 1) -> System:
        """Return the least-squares problem of gravity with these terms, on each such row."""
        if self._gravity is None:
            self._gravity = step_columns(self.model, self.motion.samples.q[self.rows])
        parts = [Part(p.unknowns, p.columns[::every]) for p in self._gravity]
        scale = step_scale(self.origin)
        first = len(scale)
        priors = [Prior(1.0 / scale ** 2, -step_from(self.origin, self.model))]
        for term in terms:
            columns = self.columns(term)[::every]
            k = columns.shape[-1]
            own = first + np.arange(k)
            for n in range(len(parts)) if columns.ndim == 3 else [self.place(term)]:
                here = columns[:, n] if columns.ndim == 3 else columns
                parts[n] = Part(np.append(parts[n].unknowns, own),
                                np.column_stack([parts[n].columns, here]))
            priors.append(self._prior(term, k))
            first += k
        rows = self.rows[::every]
        y = (self.motion.samples.tau[rows] - self.motion.gravity[rows]) - self.fixed[::every]
        return System(parts, y, self.sigma, Prior.joined(priors), self.fold[::every],
                      self.n_folds)

    def _prior(self, term: Term, k: int) -> Prior:
        """Return what is known of a term: its usual size if it has one, or what it was."""
        usual = term.effect.spread(self.motion, self.place(term), term.setting)
        if usual is not None:
            return Prior(usual ** -2, np.zeros(k))
        if term.old is None:
            return Prior(np.zeros(k), np.zeros(k))
        values = np.array([term.old.coefficients[symbol].value for symbol in self.symbols(term)])
        largest = max(float(np.abs(values).max()), 1e-9)
        return Prior(np.full(k, largest ** -2), values)

    def symbols(self, term: Term) -> list[str]:
        """Return the symbols of a term's coefficients."""
        return [c.symbol for c in term.coefficients(self.motion)]


def choose_setting(work: RefitProblem, settled: list[tuple[Term, ...]], term: Term,
                   most_rows: int = 4000) -> list[Term]:
    """
    Return the term with the best setting for each fit: one without each fold, one to all.

    Settings are compared on what each fit is fitted to, so that a held-out fold has no say in
    what it is judged by.

    :param settled: for each fit, the terms that are settled already.
    """
    place = work.place(term)
    settings = term.effect.settings(work.motion, place)
    every = -(-len(work.rows) // most_rows)
    found = [Term(term.effect, term.joint, setting) for setting in settings]
    if len(found) > 1:
        best = _best(work, settled, found, every)
        finer = {Term(term.effect, term.joint, s).key: Term(term.effect, term.joint, s)
                 for chosen in best
                 for s in term.effect.refine(work.motion, place, chosen.setting)}
        found = list({t.key: t for t in (*best, *finer.values())}.values())
    return _best(work, settled, found, every)


def _best(work: RefitProblem, settled: list[tuple[Term, ...]], found: list[Term],
          every: int) -> list[Term]:
    if len(found) == 1:
        return found * len(settled)
    errors = np.empty((len(settled), len(found)))
    for k, term in enumerate(found):
        systems: dict[object, System] = {}
        for fit, terms in enumerate(settled):
            key = tuple(t.key for t in terms)
            if key not in systems:
                systems[key] = work.system((*terms, term), every)
            which = fit if fit < len(settled) - 1 else -1
            errors[fit, k] = systems[key].training_error(which)
    return [found[k] for k in errors.argmin(axis=1)]
