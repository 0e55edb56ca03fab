"""
State of a selection of terms, and its moves on one joint: additions, exchanges and removals.

At one noise every accepted move raises the log evidence of the whole model, or removes a term
whose own gain is too small, which is then not added again. So the search ends.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from heapq import merge

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.regression.candidates import Candidates, TermFactory
from gravity_comp_ros.regression.common_settings import common_of, CommonSettings
from gravity_comp_ros.regression.design import Design, Pool
from gravity_comp_ros.regression.gains import gain_of, inflation, Ranking, score_of
from gravity_comp_ros.regression.noise import CONVERGED, precision_of
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.posterior import Posterior, solve
from gravity_comp_ros.regression.prior import Scale
from gravity_comp_ros.regression.refinement import BETTER, climbed, log_volume
from gravity_comp_ros.regression.term import is_consistent, Key, Term, with_children_of
import numpy as np

Terms = tuple[Term, ...]
# Share of the best gain from which additions on other joints are made in the same round.
_TOGETHER = 0.3


@dataclass(eq=False)
class Search:
    """
    The state of a selection: the present posterior and the terms that are not tried again.

    `forced` are keys of terms that stay in the model.
    """

    design: Design
    candidates: Candidates
    pools: tuple[Pool, ...]  # one for each joint, then that of several joints
    factory: TermFactory
    scale: Scale
    white_noise: FloatArray  # (N,) standard deviation of a row, N·m
    options: EngineOptions
    posterior: Posterior
    forced: frozenset[Key] = frozenset()
    log: Callable[[str], None] = lambda text: None
    tabu: set[Key] = field(default_factory=set)

    @property
    def terms(self) -> Terms:
        return self.posterior.terms

    @property
    def keys(self) -> set[Key]:
        return {term.key for term in self.terms}

    def select(self, terms: Iterable[Term], precision: FloatArray) -> None:
        """Take these terms, and weights (N,) of the joints."""
        self.posterior = self.solved(tuple(terms), precision)

    def renew_noise(self) -> bool:
        """Estimate the noise from the present residual; return whether it changed."""
        precision = precision_of(self.posterior, self.scale, self.options)
        ratio = precision / self.posterior.precision
        self.posterior = self.solved(self.terms, precision)
        return bool(np.abs(np.log(ratio)).max() > CONVERGED)

    def solved(self, terms: Terms, precision: FloatArray | None = None) -> Posterior:
        return solve(self.design, terms,
                     self.posterior.precision if precision is None else precision)

    def improve(self) -> bool:
        """Add, refine, exchange and remove terms, joint by joint; return whether any changed."""
        added = self._add_best()
        changed = False
        for term in self.terms:
            if term in self.terms and term.key not in self.forced:
                changed |= self._review(term)
        for own in self.groups():
            without = self.posterior.without(own)
            refined = self.common.refined(without, own, self.options.halvings)
            self.take_refined(self.replaced(own, refined))
        return added or changed

    def groups(self) -> Iterator[Terms]:
        """Yield the terms of each joint that have common parameters, where there are several."""
        for joint in range(self.design.n_joints):
            own = tuple(t for t in self.terms if t.joint == joint and t.common)
            if len(own) > 1 and not self.forced & {term.key for term in own}:
                yield own

    def replaced(self, own: Terms, new: Iterable[Term]) -> Terms:
        """Return the terms with some replaced, in the same order."""
        by_old = dict(zip(own, new))
        return tuple(by_old.get(term, term) for term in self.terms)

    def _add_best(self) -> bool:
        """Add the best term of each joint, and the best on several joints."""
        chosen = []
        for ranking in self._rankings():
            best = next(ranking, None)
            if best is not None and best[0] > self.options.min_gain:
                chosen.append(best)
        chosen.sort(key=lambda each: -each[0])
        changed = False
        for gain, term in chosen:
            if gain < _TOGETHER * chosen[0][0]:
                break
            term, gain = self.refined(self.posterior, term)
            changed |= gain > self.options.min_gain and self.accept(
                (*self.terms, term), f'add {gain:.1f}')
        return changed

    def _rankings(self) -> Iterator[Iterator[tuple[float, Term]]]:
        for pool in self.pools:
            yield self.ranking(self.posterior, pool, self.terms)

    @cached_property
    def common(self) -> CommonSettings:
        return CommonSettings(self.design, self.candidates, self.factory)

    def ranking(self, posterior: Posterior, pool: Pool, terms: Terms,
                minimum: float | None = None, key: Key | None = None
                ) -> Iterator[tuple[float, Term]]:
        """
        Return gain and term of the candidates that may be added to some terms, the best first.

        :param key: the only one of interest, if not None.
        """
        minimum = self.options.min_gain if minimum is None else minimum
        allowed = self._allowed(pool, terms, key)
        joint = pool.joints[0]
        common = {} if pool is self.pools[-1] else common_of(terms, joint)
        if not common:
            return iter(Ranking(posterior, pool, allowed, minimum))
        others = [k for k in allowed if not pool.terms[k].common]
        own = self.common.pool(joint, common)
        return merge(Ranking(posterior, pool, others, minimum),
                     Ranking(posterior, own, self._allowed(own, terms, key), minimum),
                     key=lambda each: -each[0])

    def _allowed(self, pool: Pool, terms: Terms, key: Key | None) -> list[int]:
        """Return the candidates that are not among terms, and whose corrected effect is."""
        if key is not None:
            return pool.of_key.get(key, [])
        keys = {term.key for term in terms}
        allowed: list[int] = []
        for own, numbers in pool.of_key.items():
            parents = pool.terms[numbers[0]].parents
            if own not in keys | self.tabu and (not parents or parents & keys):
                allowed += numbers
        return allowed

    def refined(self, posterior: Posterior, term: Term,
                needed: float = -np.inf) -> tuple[Term, float]:
        """
        Return a term at the best setting near its own, and its gain.

        Settings are compared at one inflation of the noise: a percent of it would outweigh one
        sample on the other side of a change point.

        :param needed: least gain of interest.
        """
        others = common_of((t for t in posterior.terms if t not in posterior.absent
                            and t is not term), term.joint)
        kappa = inflation(posterior, score_of(posterior, term))

        def near(present: Term, step: float) -> list[tuple[float, Term]]:
            return [(gain_of(posterior, other, kappa), other)
                    for other in self.factory.neighbours(present, step)
                    if not others or other.common == term.common]

        start = replace(term, log_volume=0.0)
        gain, best, tried = climbed(start, gain_of(posterior, start, kappa), near,
                                    self.options.halvings, needed)
        volume = log_volume(best.setting, self.factory.cell(best),
                            [(gain - value, other.setting) for value, other in tried
                             if other.common == best.common])
        if best is start and abs(volume - term.log_volume) < BETTER:
            return term, gain_of(posterior, term)
        best = replace(best, log_volume=volume)
        return best, gain_of(posterior, best)

    def _review(self, term: Term) -> bool:
        """Remove a term, exchange it on its own joint, or refine its setting."""
        without = self.posterior.without((term,))
        rest = with_children_of(self.terms, term)
        refined, gain = self.refined(without, term)
        if len(rest) < len(self.terms) - 1:
            # Its corrections are reviewed first, because they are nearly collinear with it.
            self._refine(term, refined)
            return False
        ranking = self.ranking(without, self.pool_of(term), rest)
        value, other = next(ranking, (-np.inf, None))
        if max(gain, value) < self.options.min_gain:
            self.tabu.add(term.key)
            self.posterior = self.solved(rest)
            self.log(f'  remove {term.key} {gain:.1f}')
            return True
        if other is not None and value > gain + self.options.significant:
            other, _ = self.refined(without, other)
            if self.accept(self.exchanged(term, other), 'exchange'):
                return True
        self._refine(term, refined)
        return False

    def _refine(self, term: Term, refined: Term) -> None:
        if refined is not term:
            self.take_refined(self.exchanged(term, refined))

    def pool_of(self, term: Term) -> Pool:
        """Return the candidates that act on the same joints as a term; the last are of the arm."""
        on_one = term.joint is not None and term.columns.ndim == 2
        return self.pools[term.joint_number] if on_one else self.pools[-1]

    def exchanged(self, old: Term, new: Term) -> Terms:
        """Return the terms with one exchanged, with the common parameters of its joint."""
        rest = [term for term in self.terms if term is not old]
        new = self.common.at(new, common_of(rest, new.joint))
        return tuple(new if term is old else term for term in self.terms)

    def with_refined(self, trial: Posterior, joints: Collection[int | None],
                     from_compared: bool = False) -> Posterior:
        """
        Return a posterior with the settings of its terms on some joints refined, one by one.

        Settings depend on each other, and their volumes on the other terms.

        :param from_compared: whether the best of the compared settings is a further start: the
            law of friction that was selected with a replaced term may be another one.
        """
        for term in trial.terms:
            if term.joint not in joints or term.key in self.forced:
                continue
            without, starts = trial.without((term,)), [term]
            if from_compared:
                rest = tuple(t for t in trial.terms if t is not term)
                ranking = self.ranking(without, self.pool_of(term), rest, -np.inf, term.key)
                starts += [next((t for _, t in ranking if t.kind == term.kind), term)]
            best, _ = max((self.refined(without, start) for start in dict.fromkeys(starts)),
                          key=lambda each: each[1])
            if best is not term:
                trial = self.solved(tuple(best if t is term else t for t in trial.terms))
        return trial

    def accept(self, terms: Terms, move: str) -> bool:
        """Take other terms if their evidence is higher with refined settings."""
        if not is_consistent(terms):
            return False
        trial = self.solved(terms)
        required = self.posterior.log_evidence + self.options.significant
        if trial.log_evidence > required:
            # Otherwise the next refinement might lower the evidence, and the search not end.
            trial = self.with_refined(trial, {t.joint for t in terms if t not in self.terms})
        if trial.log_evidence <= required:
            return False
        self._take(trial, f'{move} {trial.log_evidence - self.posterior.log_evidence:.1f}')
        return True

    def take_refined(self, terms: Terms) -> None:
        """Take the same terms at better settings, whatever share of all settings these are."""
        trial = self.solved(terms)
        gain = trial.log_evidence - self.posterior.log_evidence
        gain -= sum(t.log_volume for t in terms) - sum(t.log_volume for t in self.terms)
        if gain > 0.0:
            self._take(trial, f'refine {gain:.1f}')

    def _take(self, trial: Posterior, move: str) -> None:
        new = [(*t.key, t.setting) for t in trial.terms if t not in self.terms]
        self.log(f'  {move}: {new}')
        self.posterior = trial
