"""
Selection of terms: additions, exchanges and removals, each of which raises the evidence.

At one noise every accepted move raises the log evidence of the whole model, or removes a term
whose own gain is too small, which is then not added again. So the search ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from heapq import merge
from itertools import combinations

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.regression.candidates import Candidates, TermFactory
from gravity_comp_ros.regression.common_settings import (
    BETTER_SETTING, common_of, CommonSettings)
from gravity_comp_ros.regression.design import Design, Pool
from gravity_comp_ros.regression.gains import gain_of, inflation, Ranking, score_of, without_weak
from gravity_comp_ros.regression.noise import (
    CONVERGED, MAX_NOISES, noise_std, precision_of)
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.posterior import Posterior, solve
from gravity_comp_ros.regression.scale import Scale
from gravity_comp_ros.regression.term import is_consistent, Key, Term, with_children_of
import numpy as np

Terms = tuple[Term, ...]
# Share of the best gain from which additions on other joints are made in the same round.
_TOGETHER = 0.3
# Number of draws of a posterior, which resolves a share of 1/e to the power of the margin.
_DRAWS = 100
# Share of a term's gain that an alternative must reach to be tried.
_COMPARABLE = 0.2


@dataclass(frozen=True)
class Alternative:
    """A term that could replace another one: the log evidence and the posterior with it."""

    log_evidence: float
    term: Term
    posterior: Posterior


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
    _tabu: set[Key] = field(default_factory=set)

    @property
    def terms(self) -> Terms:
        return self.posterior.terms

    @property
    def keys(self) -> set[Key]:
        return {term.key for term in self.terms}

    def run(self, with_exchanges: bool = True) -> bool:
        """
        Select terms; return whether the selection has changed.

        :param with_exchanges: whether terms are exchanged between joints and selected again from
            other starts, which is only useful near the final estimate of the shared part.
        """
        total = 0
        for _ in range(MAX_NOISES):
            self._tabu.clear()
            rounds = 0
            while total + rounds < self.options.max_rounds and (
                    self._improve() or with_exchanges and self._exchange()):
                rounds += 1
            total += rounds
            if not self._renew_noise():
                break
        return total > 0

    def select(self, terms: Iterable[Term]) -> None:
        """Take these terms."""
        self.posterior = self._solved(tuple(terms))

    def _renew_noise(self) -> bool:
        """Estimate the noise from the present residual; return whether it changed."""
        precision = precision_of(self.posterior, self.scale, self.options)
        ratio = precision / self.posterior.precision
        self.posterior = self._solved(self.terms, precision)
        return bool(np.abs(np.log(ratio)).max() > CONVERGED)

    def _solved(self, terms: Terms, precision: FloatArray | None = None) -> Posterior:
        return solve(self.design, terms,
                     self.posterior.precision if precision is None else precision)

    def _improve(self) -> bool:
        """Add, refine, exchange and remove terms, joint by joint; return whether any changed."""
        added = self._add_best()
        changed = False
        for term in self.terms:
            if term in self.terms and term.key not in self.forced:
                changed |= self._review(term)
        for own in self._with_common():
            without = self.posterior.without(own)
            refined = self._common.refined(without, own, self.options.halvings)
            self._accept(self._replaced(own, refined), 'refine', 0.0)
        return added or changed

    def _with_common(self) -> Iterator[Terms]:
        """Yield the terms of each joint that have common parameters, where there are several."""
        for joint in range(self.design.n_joints):
            own = tuple(t for t in self.terms if t.joint == joint and t.common)
            if len(own) > 1 and not self.forced & {term.key for term in own}:
                yield own

    def _replaced(self, own: Terms, new: Iterable[Term]) -> Terms:
        """Return the terms with some replaced, in the same order."""
        by_old = dict(zip(own, new))
        return tuple(by_old.get(term, term) for term in self.terms)

    def _other_common(self) -> bool:
        """Change the common parameters of a joint to others that are compared."""
        for own in self._with_common():
            without = self.posterior.without(own)
            _, best = self._common.best(without, own, self._common.of_joint(own[0].joint_number))
            refined = self._common.refined(without, best, self.options.halvings)
            if self._accept(self._replaced(own, refined), 'exchange'):
                return True
        return False

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
            term, _ = self._refined(self.posterior, term)
            changed |= self._accept((*self.terms, term), f'add {gain:.1f}')
        return changed

    def _rankings(self) -> Iterator[Iterator[tuple[float, Term]]]:
        for pool in self.pools:
            yield self._ranking(self.posterior, pool, self.terms)

    @cached_property
    def _common(self) -> CommonSettings:
        return CommonSettings(self.design, self.candidates, self.factory)

    def _ranking(self, posterior: Posterior, pool: Pool, terms: Terms,
                 minimum: float | None = None, key: Key | None = None
                 ) -> Iterator[tuple[float, Term]]:
        """
        Return gain and term of the candidates that may be added to some terms, the best first.

        :param key: the only one of interest, if not None.
        """
        minimum = self.options.min_gain if minimum is None else minimum
        joint = pool.joints[0] if pool is not self.pools[-1] else None
        common = common_of(terms, joint)
        allowed = [k for k in self._allowed(pool, terms, key)
                   if not common or not pool.terms[k].common]
        rankings = [Ranking(posterior, pool, allowed, minimum)]
        if common and joint is not None:
            other = self._common.pool(joint, common)
            rankings.append(Ranking(posterior, other, self._allowed(other, terms, key), minimum))
        return merge(*rankings, key=lambda each: -each[0])

    def _allowed(self, pool: Pool, terms: Terms, key: Key | None) -> list[int]:
        """Return the candidates that are not among terms, and whose corrected effect is."""
        if key is not None:
            return pool.of_key.get(key, [])
        keys = {term.key for term in terms}
        allowed: list[int] = []
        for own, numbers in pool.of_key.items():
            parents = pool.terms[numbers[0]].parents
            if own not in keys | self._tabu and (not parents or parents & keys):
                allowed += numbers
        return allowed

    def _refined(self, posterior: Posterior, term: Term,
                 needed: float = -np.inf) -> tuple[Term, float]:
        """
        Return a term at the best setting near its own, and its gain.

        Settings are compared at one inflation of the noise: a percent of it would outweigh one
        sample on the other side of a change point.

        :param needed: least gain of interest. Finer steps gain less than the last two, so that the
            search ends where these would not suffice.
        """
        others = common_of((t for t in posterior.terms if t not in posterior.absent
                            and t is not term), term.joint)
        kappa = inflation(posterior, score_of(posterior, term))
        best, gain = term, gain_of(posterior, term, kappa)
        reached = [gain]
        while len(reached) <= self.options.halvings:
            tried = [(gain_of(posterior, other, kappa), other)
                     for other in self.factory.neighbours(best, 0.5 ** (len(reached) - 1))
                     if not others or other.common == term.common]
            top = max(tried, key=lambda each: each[0], default=None)
            if top is None:
                break
            if top[0] > gain + BETTER_SETTING:
                gain, best = top
                continue
            reached.append(gain)
            if len(reached) > 2 and 2.0 * gain - reached[-3] < needed:
                break
        return best, gain if best is term else gain_of(posterior, best)

    def _review(self, term: Term) -> bool:
        """Remove a term, exchange it on its own joint, or refine its setting."""
        without = self.posterior.without((term,))
        rest = with_children_of(self.terms, term)
        refined, gain = self._refined(without, term)
        if len(rest) < len(self.terms) - 1:
            # Its corrections are reviewed first, because they are nearly collinear with it.
            return refined is not term and self._accept(
                self._exchanged(term, refined), 'refine', 0.0)
        ranking = self._ranking(without, self._pool_of(term), rest)
        value, other = next(ranking, (-np.inf, None))
        if max(gain, value) < self.options.min_gain:
            self._tabu.add(term.key)
            self.posterior = self._solved(rest)
            self.log(f'  remove {term.key} {gain:.1f}')
            return True
        if other is not None and value > gain + self.options.significant:
            other, _ = self._refined(without, other)
            if self._accept(self._exchanged(term, other), 'exchange'):
                return True
        if refined is not term:
            return self._accept(self._exchanged(term, refined), 'refine', 0.0)
        return False

    def _pool_of(self, term: Term) -> Pool:
        """Return the candidates that act on the same joints as a term; the last are of the arm."""
        on_one = term.joint is not None and term.columns.ndim == 2
        return self.pools[term.joint_number] if on_one else self.pools[-1]

    def _exchanged(self, old: Term, new: Term) -> Terms:
        rest = [term for term in self.terms if term is not old]
        new = self._common.at(new, common_of(rest, new.joint))
        return tuple(new if term is old else term for term in self.terms)

    def _accept(self, terms: Terms, move: str, minimum: float | None = None) -> bool:
        """Take other terms if their evidence is higher."""
        if not is_consistent(terms):
            return False
        minimum = self.options.significant if minimum is None else minimum
        trial = self._solved(terms)
        gain = trial.log_evidence - self.posterior.log_evidence
        if gain <= minimum:
            return False
        new = [t for t in terms if t not in self.terms]
        self.log(f'  {move} {[(*t.key, t.setting) for t in new]} {gain:.1f}')
        self.posterior = trial
        return minimum > 0.0

    def _exchange(self) -> bool:
        """Exchange terms between joints, merge equal ones, or select a joint again."""
        return (self._other_common() or self._between_joints() or self._merge() or self._pair() or self._unpair()
                or self._again())

    def _pair(self) -> bool:
        """
        Add two terms to a joint whose residual is not white, of which none helps alone.

        Friction that falls and then rises with speed is such a pair.
        """
        terms = self.terms
        for joint in np.flatnonzero(self._coloured()):
            chosen: dict[Key, Term] = {}
            for _, term in self._ranking(self.posterior, self.pools[joint], terms, -np.inf):
                chosen.setdefault(term.key, term)
            for term in chosen.values():
                trial = self._solved((*terms, term))
                partner = next(self._ranking(trial, self.pools[joint], trial.terms), None)
                if partner is not None and self._accept(
                        self._without_weak((*trial.terms, partner[1])), 'pair'):
                    return True
        return False

    def _unpair(self) -> bool:
        """
        Replace two terms of a joint by one.

        A term at a poor setting may have been corrected by another one.
        """
        for one, other in combinations(self.terms, 2):
            rest = tuple(t for t in self.terms if t not in (one, other))
            if (one.joint is None or one.joint != other.joint or not is_consistent(rest)
                    or self.forced & {one.key, other.key}):
                continue
            without = self.posterior.without((one, other))
            best = next(self._ranking(without, self._pool_of(one), rest), None)
            if best is not None and self._accept(
                    (*rest, self._refined(without, best[1])[0]), 'unpair'):
                return True
        return False

    def alternatives(self, term: Term) -> list[Alternative]:
        """
        Return other terms on any joint that could replace one, the most probable first.

        Each effect of a comparable gain has its best setting.
        """
        without = self.posterior.without((term,))
        rest = with_children_of(self.terms, term)
        own = gain_of(without, term)
        minimum = max(self.options.min_gain, _COMPARABLE * own)
        chosen: dict[Key, tuple[float, Term]] = {}
        for pool in self.pools:
            for gain, other in self._ranking(without, pool, rest, minimum):
                if other.key != term.key and gain > chosen.get(other.key, (-np.inf,))[0]:
                    chosen[other.key] = gain, other
        needed = own - self.options.near
        return self._replacing(term, [self._refined(without, other, needed)[0]
                                      for _, other in chosen.values()])

    def excluded_alternatives(self, term: Term) -> list[Alternative]:
        """Return the untestable effects of its joint that could replace a term, likewise."""
        return self._replacing(term, [other for other in self.candidates.excluded
                                      if other.joint == term.joint])

    def _replacing(self, term: Term, others: Iterable[Term]) -> list[Alternative]:
        results = []
        for other in others:
            terms = self._exchanged(term, other)
            if not is_consistent(terms):
                continue
            trial = self._solved(terms)
            if trial.log_evidence > self.posterior.log_evidence - self.options.near:
                trial = self._solved(self._with_refined(terms, other))
            at = next(t for t in trial.terms if t.key == other.key)
            results.append(Alternative(trial.log_evidence + _log_share_plausible(trial, at),
                                       at, trial))
        return sorted(results, key=lambda each: -each.log_evidence)

    def _with_refined(self, terms: Terms, new: Term) -> Terms:
        """
        Return terms with the settings of a new one, and of others on its joint, refined.

        The law of friction that was selected with the replaced term may be another one.
        """
        for term in terms:
            if term.joint == new.joint and term.key not in self.forced:
                without, pool = self._solved(terms).without((term,)), self._pool_of(term)
                rest = tuple(t for t in terms if t is not term)
                _, other = next(self._ranking(without, pool, rest, -np.inf, term.key), (0.0, term))
                best, _ = max((self._refined(without, start)
                               for start in dict.fromkeys((term, other))),
                              key=lambda each: each[1])
                terms = tuple(best if t is term else t for t in terms)
        return terms

    def _between_joints(self) -> bool:
        for term in self.terms:
            if term.key in self.forced:
                continue
            best = next(iter(self.alternatives(term)), None)
            minimum = self.posterior.log_evidence + self.options.significant
            if best is not None and best.log_evidence > minimum and self._accept(
                    best.posterior.terms, 'exchange'):
                return True
        return False

    def _merge(self) -> bool:
        """Replace equal effects on several joints by one on another joint."""
        for name in sorted({term.name for term in self.terms}):
            same = tuple(t for t in self.terms if t.name == name and t.key not in self.forced)
            if len(same) < 2:
                continue
            without = self.posterior.without(same)
            rest = tuple(t for t in self.terms if t not in same)
            joints = {t.joint for t in same}
            others = [c for part in self.candidates.of_joint for c in part
                      if c.name == name and c.joint not in joints]
            best = max(((gain_of(without, c), k) for k, c in enumerate(others)),
                       default=None)
            if best is None:
                continue
            new = others[best[1]]
            new = self._common.at(new, common_of(rest, new.joint))
            if self._accept((*rest, new), 'merge'):
                return True
        return False

    def _again(self) -> bool:
        """
        Select the terms of a joint again from other starts: those that act at rest.

        All of them, where the residual is not white.
        """
        coloured = self._coloured()
        for joint in range(self.design.n_joints):
            own = tuple(t for t in self.terms if t.joint == joint and t.columns.ndim == 2
                        and t.key not in self.forced)
            static = tuple(t for t in own if t.effect.is_static)
            for dropped in dict.fromkeys((own, static) if coloured[joint] else (static,)):
                if len(dropped) > 1 and self._select_again(joint, dropped):
                    return True
        return False

    def _coloured(self) -> BoolArray:
        """Return the joints (N,) whose residual is not white: a term may be missing."""
        return (noise_std(self.posterior, self.scale, self.options)
                > self.options.coloured * self.white_noise)

    def _select_again(self, joint: int, dropped: Terms) -> bool:
        """Replace terms of a joint by those that are selected from the best of a few starts."""
        rest = tuple(t for t in self.terms if t not in dropped)
        if not is_consistent(rest):
            return False
        without = self.posterior.without(dropped)
        starts: dict[str, Term] = {}
        for _, term in self._ranking(without, self.pools[joint], rest):
            if len(starts) >= self.options.starts:
                break
            starts.setdefault(term.name, term)
        for start in starts.values():
            # A setting that is refined while other terms are missing may be better or worse.
            for first in dict.fromkeys((start, self._refined(without, start)[0])):
                grown = self._grown((*rest, first), joint)
                if self._accept(self._without_weak(grown), 'again'):
                    return True
        return False

    def _without_weak(self, terms: Terms) -> Terms:
        """Return terms without the new ones that would be removed again."""
        return without_weak(self._solved(terms), lambda term: term not in self.terms,
                            self.options.min_gain).terms

    def _grown(self, terms: Terms, joint: int) -> Terms:
        """Return terms with those of a joint that raise the evidence, added one by one."""
        posterior, start = self._solved(terms), terms[-1]
        for _ in range(self.options.max_rounds):
            ranking = self._ranking(posterior, self.pools[joint], terms)
            gain, best = next(ranking, (-np.inf, None))
            if best is None or gain < self.options.min_gain:
                break
            best, _ = self._refined(posterior, best)
            trial = self._solved((*terms, best))
            if trial.log_evidence <= posterior.log_evidence:
                break
            posterior, terms = trial, trial.terms
        best, _ = self._refined(posterior.without((start,)), start)
        return tuple(best if term is start else term for term in terms)


def _log_share_plausible(posterior: Posterior, term: Term) -> float:
    """
    Return the logarithm of the share of a term's posterior that is physical, from draws.

    Signs are in the evidence already (`gains`).
    """
    if term.effect.why_not_negative:
        return 0.0
    here = posterior.at[term]
    draws = np.random.default_rng(0).multivariate_normal(
        posterior.beta[here], posterior.covariance[np.ix_(here, here)], _DRAWS, method='eigh')
    plausible = sum(term.effect.implausible(draw, term.setting) is None for draw in draws)
    return float(np.log((plausible + 1.0) / (_DRAWS + 1.0)))
