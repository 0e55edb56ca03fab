"""
Selection of effects: forward selection, then removal and replacement.

Effects are compared by held-out errors of blocks (`evaluation/gain.py`), and p-values are
corrected for the number of effects, joints and nonlinear parameters tested. Among effects with
equal gain within one standard error, the simplest is chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.criteria import Criteria, Key, MAX_COLUMNS
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.effects.effect import Expectation
from gravity_comp_ros.evaluation.gain import Gain, gain, log_ratio, within_standard_error
import numpy as np

# Maximum number of rounds of addition, removal and replacement.
_ROUNDS = 4
_FRICTION = 'coulomb_friction'
_NO_GAIN = Gain(np.zeros(2), 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Selection:
    """The chosen effects, the refused ones with the reason, and the criteria."""

    chosen: tuple[Candidate, ...]
    refused: Mapping[Key, str]
    criteria: Criteria

    @property
    def fits(self) -> Fits:
        return self.criteria.fits

    def effect_torque(self) -> FloatArray:
        """Return the torque (M, N) of the chosen effects in N·m."""
        return np.column_stack([self.fits.torque(joint, self.chosen, self.chosen)
                                for joint in range(self.fits.n_joints)])


def select(criteria: Criteria, refused: Collection[Key] = ()) -> Selection:
    """
    Return the selected effects.

    A rare effect can be a substitute for several simple ones. It is kept only if it is needed in
    addition to the effects that are selected without it.

    :param refused: effects that are not selected; they remain alternatives of simpler effects.
    """
    selection = _searched(criteria, refused)
    for candidate in selection.chosen:
        if _may_be_substitute(candidate, selection.chosen):
            without = _searched(criteria, {*refused, candidate.key})
            if not (criteria.is_needed(candidate, without.chosen)
                    and criteria.exceeds_dynamics(candidate, without.chosen)
                    or _explains_more(candidate, selection, without)):
                return without
    return selection


def _explains_more(candidate: Candidate, selection: Selection, without: Selection) -> bool:
    """
    Return whether a selection with a rare effect explains more than one without it.

    An effect with many columns explains more in any case, and must be needed in addition.
    """
    fits, joint = selection.fits, candidate.acts_on
    if len(candidate.columns) > MAX_COLUMNS:
        return False
    before, after = (fits.errors(joint, each.chosen) for each in (without, selection))
    return gain(before, after, 1).p < selection.criteria.options.alpha


def _may_be_substitute(candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
    """Return whether a rare effect has many columns, or is chosen without Coulomb friction."""
    if candidate.effect.expectation != Expectation.RARE:
        return False
    return len(candidate.columns) > MAX_COLUMNS or (
        _FRICTION in candidate.effect.confounders
        and not any((c.effect.name, c.joint) == (_FRICTION, candidate.joint) for c in chosen))


def _searched(criteria: Criteria, simplified: Collection[Key]) -> Selection:
    """
    Return the selection without some effects.

    These remain alternatives of the simpler effects that explain as much.
    """
    search = _Search(criteria, dict.fromkeys(simplified, 'simpler effects explain as much'))
    if search.chosen:
        search.remove_useless()
        search.add_all()
        search.remove_insignificant()
    for _ in range(_ROUNDS):
        search.add_all()
        if not (search.remove_redundant() or search.replace_one()):
            break
    refused = {key: why for key, why in search.refused.items() if key not in simplified}
    return Selection(tuple(search.chosen), refused, criteria)


class _Search:
    """The effects chosen so far, and the gain of every other one in addition to them."""

    def __init__(self, criteria: Criteria,
                 refused: Mapping[Key, str]) -> None:
        self.criteria = criteria
        self.fits = criteria.fits
        self.chosen = criteria.initial(refused)
        self.refused = dict(refused)
        self._gains: dict[int, Gain] = {}
        # Shared effects whose gain was computed with another set of effects.
        self._outdated: set[int] = set()
        self._changed = False

    def remove_useless(self) -> None:
        """
        Remove effects that do not reduce the held-out error.

        Significance is tested later. Until then, small friction remains as a nuisance term and
        reduces the bias of the other effects.
        """
        self._remove_all(lambda c: -self.criteria.gain_given(c, self._without(c)).mean, 0.0)

    def remove_insignificant(self) -> None:
        """Remove effects that are not significant."""
        self._remove_all(lambda c: self.criteria.p_value(c, self._without(c)),
                         self.criteria.options.alpha)

    def _remove_all(self, score: Callable[[Candidate], float], limit: float) -> None:
        """
        Remove effects with a score of at least a limit and unphysical ones, worst first.

        Effects of one joint mask each other; those of other joints affect it through gravity and
        dynamics alone. So scores of other joints are computed again at the end only.
        """
        scores: dict[int, float] = {}
        while self.chosen:
            new = [c for c in self.chosen if id(c) not in scores]
            scores.update({id(c): score(c) for c in new})
            failing = [c for c in self.chosen if scores[id(c)] >= limit
                       or not self.criteria.is_physical(c, self.chosen)]
            if failing:
                worst = _worst_of_each_joint(failing, scores)
                joints = {c.acts_on for c in worst}
                self._set_chosen([c for c in self.chosen if c not in worst])
                scores = {id(c): scores[id(c)] for c in self.chosen
                          if not joints & {None, c.acts_on} and not c.shared}
            elif len(new) < len(self.chosen):
                scores.clear()
            else:
                break

    def add_all(self) -> None:
        """Add effects until none is accepted."""
        while len(self.chosen) < self.criteria.options.max_effects and (
                self.add_best() or self.add_best_with_current_gains()):
            pass

    def add_best(self) -> bool:
        """Add the simplest of the best effects; return False if none is accepted."""
        gains, criteria = self._all_gains(), self.criteria
        rejected: set[int] = set()
        while True:
            significant = [c for c in self._available() if id(c) not in rejected
                           and gains[id(c)].p < criteria.options.alpha
                           and gains[id(c)].share > criteria.min_share(c)]
            if not significant:
                return False
            best = max(significant, key=lambda c: gains[id(c)].mean)
            equal = [c for c in significant if self._is_equal(c, best, gains)]
            if any(id(c) in self._outdated for c in equal):
                self._update_gains([c for c in equal if id(c) in self._outdated])
                continue
            simplest = min(equal, key=lambda c: (c.complexity, -gains[id(c)].mean))
            reason = criteria.unphysical(simplest, [*self.chosen, simplest])
            if reason is None and criteria.exceeds_dynamics(simplest, self.chosen):
                self._set_chosen([*self.chosen, simplest])
                return True
            if reason is not None:
                self.refused[simplest.key] = reason
            rejected.add(id(simplest))

    def add_best_with_current_gains(self) -> bool:
        """Do the same after computing all gains again, if the chosen effects have changed."""
        if not self._changed:
            return False
        self._gains.clear()
        self._outdated.clear()
        self._changed = False
        return self.add_best()

    def remove_redundant(self) -> bool:
        """Remove one effect that is no longer needed, lacks its parent, or is not physical."""
        # An effect that corrects another is removed before it.
        for candidate in sorted(self.chosen, key=lambda c: not c.effect.corrects):
            rest = self._without(candidate)
            if not (self.criteria.has_parent(candidate, {c.key for c in rest})
                    and self.criteria.is_needed(candidate, rest)):
                self._set_chosen(rest)
                return True
            if candidate.effect.certain and not self.criteria.is_physical(candidate, self.chosen):
                self.refused[candidate.key] = 'it is not physical together with the other effects'
                self._set_chosen(rest)
                return True
        return False

    def _without(self, candidate: Candidate) -> list[Candidate]:
        return [c for c in self.chosen if c is not candidate]

    def replace_one(self) -> bool:
        """Replace a chosen effect by one that explains more, or by a simpler equivalent."""
        criteria = self.criteria
        for candidate in list(self.chosen):
            rest = self._without(candidate)
            others = criteria.replacements(candidate, self.chosen, self.refused)
            for other, with_it, with_other in criteria.with_each_replacement(
                    candidate, others, self.chosen):
                if other.complexity < candidate.complexity:
                    better = (within_standard_error(with_it, with_other)
                              or self._is_negligible(log_ratio(with_other, with_it),
                                                     candidate, other))
                else:
                    better = not within_standard_error(with_other, with_it)
                if (better and criteria.is_physical(other, [*rest, other])
                        and criteria.is_needed(other, rest)
                        and criteria.exceeds_dynamics(other, rest)):
                    self._set_chosen([*rest, other])
                    return True
        return False

    def _is_equal(self, candidate: Candidate, best: Candidate, gains: Mapping[int, Gain]) -> bool:
        """Return whether a candidate explains as much as the best one."""
        if candidate is best:
            return True
        if candidate.joint != best.joint and not (candidate.shared or best.shared):
            return False
        d = gains[id(best)].blocks - gains[id(candidate)].blocks
        return bool(d.mean() <= d.std(ddof=1) / np.sqrt(len(d))
                    or self._is_negligible(d, best, candidate))

    def _is_negligible(self, excess: FloatArray, complex_one: Candidate,
                       simple_one: Candidate) -> bool:
        """
        Return whether the excess gain (B,) of a more complex effect is too small for its size.

        Each further coefficient must reduce the error by the share that an effect must.
        """
        further = complex_one.complexity - simple_one.complexity
        return bool(further > 0 and not (complex_one.shared or simple_one.shared)
                    and excess.mean() < further * self.criteria.options.min_share)

    def _available(self) -> list[Candidate]:
        return self.criteria.available(self.chosen, self.refused)

    def _all_gains(self) -> dict[int, Gain]:
        """Return the gain of every available candidate; missing ones are computed."""
        missing = [c for c in self._available() if id(c) not in self._gains]
        self._gains.update({id(c): _NO_GAIN for c in missing})
        self._update_gains(self.criteria.promising(missing, self.chosen))
        return self._gains

    def _update_gains(self, candidates: list[Candidate]) -> None:
        """Compute gains in addition to the chosen effects."""
        joints: list[int | None] = [None, *range(self.fits.n_joints)]
        for joint in joints:
            here = [c for c in candidates if c.acts_on == joint]
            if not here:
                continue
            before = self.fits.errors(joint, self.chosen)
            for c, after in zip(here, self.fits.errors_with_each(joint, self.chosen, here)):
                self._gains[id(c)] = self.criteria.gain_of(c, before, after, self.chosen)
                self._outdated.discard(id(c))

    def _set_chosen(self, chosen: list[Candidate]) -> None:
        """Replace the chosen effects, and discard the gains that this changes."""
        before, now = {id(c): c for c in self.chosen}, {id(c): c for c in chosen}
        changed = [c for key, c in {**before, **now}.items() if (key in before) != (key in now)]
        self.chosen, self._changed = chosen, True
        if any(c.shared for c in changed):
            self._gains.clear()
            self._outdated.clear()
            return
        joints = {c.joint for c in changed}
        for c in self.criteria.candidates:
            if c.shared:
                self._outdated.add(id(c))
            elif c.joint in joints:
                self._gains.pop(id(c), None)


def _worst_of_each_joint(failing: Sequence[Candidate],
                         scores: Mapping[int, float]) -> list[Candidate]:
    """Return the effect with the largest score of each joint, or only it if it is shared."""
    ordered = sorted(failing, key=lambda c: -scores[id(c)])
    if ordered[0].shared:
        return ordered[:1]
    return list({c.joint: c for c in reversed(ordered) if not c.shared}.values())
