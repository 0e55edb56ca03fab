"""
Which effects the data asks for: forward by evidence, then removal and swaps.

Every comparison is made on blocks that the fit has not seen (`gain.py`), and p-values count for
less because of the effects, joints and settings that were tried. Among effects that explain as
much within one standard error, the simplest is taken, and what is as simple and as good remains
as its rival.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.diagnosis.candidates import Candidate, Columns, MOTION, RARE
from gravity_comp_ros.diagnosis.evidence import (
    Fit, held_out_errors, JointGram, Prior, shared_information, solve)
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.evaluation.blocks import Blocks
from gravity_comp_ros.evaluation.gain import Gain, gain, gain_of_motion, not_worse, share
import numpy as np

_ROUNDS = 4
# (candidate, coefficients in its own units) -> why they are not physical, or None.
Implausible = Callable[[Candidate, FloatArray], 'str | None']


@dataclass(frozen=True)
class SelectionOptions:
    """
    When an effect counts.

    `alpha` is the family-wise chance of a false alarm; `least_share` of a joint's held-out
    error must go for an effect to be worth a name, `least_rare_share` for one that is not
    expected in every joint; `most` effects are looked for in all.

    :raises OptionError: if a value is out of range.
    """

    alpha: float = 0.01
    least_share: float = 0.004
    least_rare_share: float = 0.1
    most: int = 40

    def __post_init__(self) -> None:
        if not 0.0 < self.alpha < 1.0 or self.most < 1:
            raise OptionError('selection: alpha lies in (0, 1), most is at least 1')
        if not (0.0 <= self.least_share < 1.0 and 0.0 <= self.least_rare_share < 1.0):
            raise OptionError('selection: least_share and least_rare_share lie in [0, 1)')


class Selection:
    """The effects chosen so far, and the errors with and without any other."""

    def __init__(self, grams: list[JointGram], columns: Columns, candidates: list[Candidate],
                 blocks: Blocks, implausible: Implausible, options: SelectionOptions,
                 given: frozenset[tuple[str, int | None]] = frozenset()) -> None:
        self.grams, self.columns, self.blocks = grams, columns, blocks
        self.candidates, self.given = candidates, given
        self.implausible, self.options = implausible, options
        self.chosen: list[Candidate] = []
        self.refused: dict[tuple[str, int | None], str] = {}
        # The last setting of an effect of motion has the most columns.
        self._dynamics = list({c.key: c for c in candidates
                               if c.expectation == MOTION}.values())
        self._tried = Counter({c.key: c.expectation for c in candidates}.values())
        self._priors: dict[tuple[int, bytes, bytes], Prior] = {}
        self._gains: dict[int, Gain] = {}
        self._stale = False

    def run(self) -> None:
        """Choose effects until none pays; drop and swap what no longer does."""
        for _ in range(_ROUNDS):
            while len(self.chosen) < self.options.most and (
                    self._add_best() or self._add_best_afresh()):
                pass
            if not (self._remove_idle() or self._swap_better()):
                break

    def tests(self, candidate: Candidate) -> float:
        """
        Return by how much a p-value counts for less, because so much was tried.

        The weighted Bonferroni correction: what moves, what is expected in every joint and all
        the rest get the same part of the chance of a false alarm (Genovese et al., Biometrika
        93, 2006).
        """
        return len(self._tried) * self._tried[candidate.expectation] * candidate.tried

    def gain_of(self, candidate: Candidate, before: FloatArray, after: FloatArray) -> Gain:
        """Return the gain; what fast motion needs shows in the few blocks that have it."""
        how = gain_of_motion if candidate.expectation == MOTION else gain
        return how(before, after, self.tests(candidate))

    def least_share(self, candidate: Candidate) -> float:
        """Return the share of the error that must go; shared effects count on all joints."""
        return self.options.least_share / (len(self.grams) if candidate.shared else 1)

    # -- fits ---------------------------------------------------------------------------

    def shared(self, chosen: list[Candidate]) -> IntArray:
        """Return the shared columns in use: the base and chosen effects of the arm."""
        extra = [c.columns for c in chosen if c.shared]
        return np.concatenate([np.arange(self.columns.n_base), *extra]).astype(np.int64)

    def own(self, joint: int, chosen: list[Candidate]) -> IntArray:
        """Return a joint's own columns in use."""
        parts = [c.columns for c in chosen if not c.shared and c.joint == joint]
        return np.concatenate([np.zeros(0, dtype=np.int64), *parts]).astype(np.int64)

    def prior(self, joint: int, chosen: list[Candidate]) -> Prior:
        """Return what the other joints tell about the shared columns."""
        shared = self.shared(chosen)
        others = [self._information(n, shared, self.own(n, chosen))
                  for n in range(len(self.grams)) if n != joint]
        size = (self.blocks.n_folds + 1, len(shared))
        return Prior(sum((o.information for o in others), np.zeros((*size, len(shared)))),
                     sum((o.vector for o in others), np.zeros(size)))

    def _information(self, n: int, shared: IntArray, own: IntArray) -> Prior:
        key = (n, shared.tobytes(), own.tobytes())
        if key not in self._priors:
            self._priors[key] = shared_information(
                self.grams[n], np.concatenate([shared, own]), len(shared))
        return self._priors[key]

    def fit(self, joint: int, chosen: list[Candidate]) -> Fit:
        """Return the fit of one joint with these effects."""
        shared = self.shared(chosen)
        columns = np.concatenate([shared, self.own(joint, chosen)])
        return solve(self.grams[joint], columns, len(shared), self.prior(joint, chosen))

    def errors(self, joint: int | None, chosen: list[Candidate]) -> FloatArray:
        """Return held-out errors block by block, of one joint or of all: (B, J)."""
        joints = range(len(self.grams)) if joint is None else [joint]
        return np.column_stack([held_out_errors(self.grams[n], self.fit(n, chosen), self.blocks)
                                for n in joints])

    def coefficients(self, candidate: Candidate, chosen: list[Candidate]) -> FloatArray:
        """Return a chosen effect's coefficients in its own units, from all data."""
        joint = candidate.joint or 0
        fit = self.fit(joint, chosen)
        here = np.isin(fit.columns, candidate.columns)
        return fit.all_data[here] / self.grams[joint].scale[fit.columns[here]]

    def effect_torque(self) -> FloatArray:
        """Return what the chosen effects make of the torque (M, N) in N·m."""
        parts = []
        for joint, gram in enumerate(self.grams):
            fit = self.fit(joint, self.chosen)
            here = fit.columns >= self.columns.n_base
            used = fit.columns[here]
            parts.append(self.columns.of_joint(joint)[:, used]
                         @ (fit.all_data[here] / gram.scale[used]))
        return np.column_stack(parts)

    # -- steps --------------------------------------------------------------------------

    def _add_best(self) -> bool:
        """Add the simplest of the best effects; return False if none pays."""
        gains = self._all_gains()
        paying = [c for c in self._open() if gains[id(c)].p < self.options.alpha
                  and gains[id(c)].share > self.least_share(c)]
        while paying:
            best = max(paying, key=lambda c: gains[id(c)].mean)
            alike = [c for c in paying if self._is_alike(c, best, gains)]
            taken = min(alike, key=lambda c: (c.complexity, -gains[id(c)].mean))
            reason = self.implausible(taken, self.coefficients(taken, [*self.chosen, taken]))
            if reason is None and self.is_more_than_motion(taken, self.chosen):
                self._change([*self.chosen, taken])
                return True
            if reason is not None:
                self.refused[taken.key] = reason
            paying.remove(taken)
        return False

    def _add_best_afresh(self) -> bool:
        """Do the same with gains that know what was added on other joints since."""
        if not self._stale:
            return False
        self._gains.clear()
        self._stale = False
        return self._add_best()

    def _is_alike(self, candidate: Candidate, best: Candidate, gains: dict[int, Gain]) -> bool:
        if candidate is best:
            return True
        if candidate.joint != best.joint and not (candidate.shared or best.shared):
            return False
        d = gains[id(best)].blocks - gains[id(candidate)].blocks
        return bool(d.mean() <= d.std(ddof=1) / np.sqrt(len(d)))

    def is_more_than_motion(self, candidate: Candidate, chosen: list[Candidate]) -> bool:
        """
        Return whether a rare effect explains much that no inertia or Coriolis torque does.

        Every arm that moves has those, named or not, and no few columns hold all of them; what a
        rare effect explains of them is not its own. What is expected in every joint needs no
        such proof.
        """
        if candidate.expectation != RARE:
            return True
        moving = [c for c in self._dynamics
                  if c not in chosen and (candidate.shared or c.joint == candidate.joint)]
        joint = None if candidate.shared else candidate.joint
        given = [*chosen, *moving]
        before, after = self.errors(joint, given), self.errors(joint, [*given, candidate])
        if gain(before, after, self.tests(candidate)).p >= self.options.alpha:
            return False
        shares = [share(before[:, [n]], after[:, [n]]) for n in range(before.shape[1])]
        return max(shares) >= self.options.least_rare_share

    def _remove_idle(self) -> bool:
        """Drop chosen effects that the others have made needless."""
        # What corrects another effect goes before it.
        for candidate in sorted(self.chosen, key=lambda c: not c.effect.corrects):
            rest = [c for c in self.chosen if c is not candidate]
            if not self.is_needed(candidate, rest):
                self._change(rest)
                return True
        return False

    def is_needed(self, candidate: Candidate, rest: list[Candidate]) -> bool:
        """Return whether an effect pays beside the rest of what is chosen."""
        joint = None if candidate.shared else candidate.joint
        kept = self.gain_of(candidate, self.errors(joint, rest),
                            self.errors(joint, [*rest, candidate]))
        return (kept.p < self.options.alpha
                and kept.share >= 0.5 * self.least_share(candidate))

    def _swap_better(self) -> bool:
        """Replace a chosen effect by one that explains more, or as much more simply."""
        for candidate in list(self.chosen):
            rest = [c for c in self.chosen if c is not candidate]
            scopes: dict[int | None, FloatArray] = {}
            for other in self.replacements(candidate):
                now, then = self._with_and_instead(candidate, other, rest, scopes)
                if other.complexity < candidate.complexity:
                    pays = not_worse(now, then)
                else:
                    pays = not not_worse(then, now)
                if (pays and self._is_physical(other, [*rest, other])
                        and self.is_needed(other, rest)
                        and self.is_more_than_motion(other, rest)):
                    self._change([*rest, other])
                    return True
        return False

    def rivals(self, candidate: Candidate) -> list[Candidate]:
        """Return effects as simple that would explain as much in a chosen one's place."""
        rest = [c for c in self.chosen if c is not candidate]
        scopes: dict[int | None, FloatArray] = {}
        found: dict[tuple[str, int | None], Candidate] = {}
        for other in self.replacements(candidate):
            if other.complexity > candidate.complexity or other.key == candidate.key:
                continue
            now, then = self._with_and_instead(candidate, other, rest, scopes)
            if not_worse(now, then) and self._is_physical(other, [*rest, other]):
                found.setdefault(other.key, other)
        return list(found.values())

    def _with_and_instead(self, candidate: Candidate, other: Candidate, rest: list[Candidate],
                          scopes: dict[int | None, FloatArray]
                          ) -> tuple[FloatArray, FloatArray]:
        """
        Return the errors with a chosen effect and with another in its place.

        On the joint of both, or on all joints if either acts on more. `scopes` keeps the first.
        """
        joint = None if candidate.shared or other.shared else candidate.joint
        if joint not in scopes:
            scopes[joint] = self.errors(joint, self.chosen)
        return scopes[joint], self.errors(joint, [*rest, other])

    def replacements(self, candidate: Candidate) -> list[Candidate]:
        """Return what could stand in a chosen effect's place, on its joint or on the arm."""
        taken = {c.key for c in self.chosen if c is not candidate}
        return [c for c in self.candidates if c is not candidate
                and c.key not in taken and c.key not in self.refused
                and self._has_parent(c, taken)
                and (c.joint == candidate.joint or c.shared or candidate.shared)]

    def _is_physical(self, candidate: Candidate, chosen: list[Candidate]) -> bool:
        return self.implausible(candidate, self.coefficients(candidate, chosen)) is None

    def _open(self) -> list[Candidate]:
        taken = {c.key for c in self.chosen}
        return [c for c in self.candidates
                if c.key not in taken and c.key not in self.refused
                and self._has_parent(c, taken)]

    def open_on(self, joint: int) -> list[Candidate]:
        """Return the physical effects of one joint that are not chosen."""
        return [c for c in self._open() if c.joint == joint and not c.shared
                and self._is_physical(c, [*self.chosen, c])]

    def _has_parent(self, candidate: Candidate, taken: set[tuple[str, int | None]]) -> bool:
        corrects, there = candidate.effect.corrects, taken | self.given
        return not corrects or any((name, candidate.joint) in there for name in corrects)

    def _all_gains(self) -> dict[int, Gain]:
        before: dict[int | None, FloatArray] = {}
        for c in self._open():
            if id(c) in self._gains:
                continue
            joint = None if c.shared else c.joint
            if joint not in before:
                before[joint] = self.errors(joint, self.chosen)
            self._gains[id(c)] = self.gain_of(c, before[joint],
                                              self.errors(joint, [*self.chosen, c]))
        return self._gains

    def _change(self, chosen: list[Candidate]) -> None:
        """Take a set of effects; forget the gains that it has changed."""
        changed = {id(c): c for c in (*chosen, *self.chosen)}
        same = {id(c) for c in chosen} & {id(c) for c in self.chosen}
        moved = [c for key, c in changed.items() if key not in same]
        self.chosen, self._stale = chosen, True
        if any(c.shared for c in moved):
            self._gains.clear()
            self._priors.clear()
            return
        joints = {c.joint for c in moved}
        for c in self.candidates:
            if c.shared or c.joint in joints:
                self._gains.pop(id(c), None)
