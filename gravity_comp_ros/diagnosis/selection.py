"""
Which effects the data asks for: forward by evidence, then removal and swaps.

Every comparison is made on blocks that the fit has not seen (`gain.py`), and p-values are
corrected for the effects, joints and scanned parameters that were tried. Among effects that
explain as much within one standard error, the simplest is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.criteria import Criteria
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.effects.effect import Expectation
from gravity_comp_ros.evaluation.gain import Gain, within_standard_error
import numpy as np

_ROUNDS = 4
# So many columns can stand for several effects.
_MANY = 8
_USUAL_FRICTION = 'coulomb_friction'
_NO_GAIN = Gain(np.zeros(2), 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Selection:
    """The chosen effects, those that are not physical with the reason, and the criteria."""

    chosen: tuple[Candidate, ...]
    refused: Mapping[tuple[str, int | None], str]
    criteria: Criteria

    @property
    def fits(self) -> Fits:
        return self.criteria.fits

    def effect_torque(self) -> FloatArray:
        """Return the torque (M, N) of the chosen effects in N·m."""
        return np.column_stack([self.fits.torque(joint, self.chosen, self.chosen)
                                for joint in range(self.fits.n_joints)])


def select(criteria: Criteria) -> Selection:
    """
    Choose effects until none pays; drop and swap what no longer does.

    A rare effect can stand for several simple ones, each of which would be the better name. So it
    stays only if it pays beside what is chosen where it may not be.
    """
    found = _searched(criteria, {})
    for candidate in found.chosen:
        if _may_stand_for_others(candidate, found.chosen):
            without = _searched(criteria, {candidate.key: 'simpler effects explain as much'})
            if not (criteria.is_needed(candidate, without.chosen)
                    and criteria.is_more_than_motion(candidate, without.chosen)):
                return without
    return found


def _may_stand_for_others(candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
    """Return whether a rare effect has many columns, or is there instead of Coulomb friction."""
    if candidate.effect.expectation != Expectation.RARE:
        return False
    return len(candidate.columns) > _MANY or (
        _USUAL_FRICTION in candidate.effect.confounders
        and not any((c.effect.name, c.joint) == (_USUAL_FRICTION, candidate.joint)
                    for c in chosen))


def _searched(criteria: Criteria, refused: Mapping[tuple[str, int | None], str]) -> Selection:
    """Return what is chosen where some effects are refused from the start."""
    search = _Search(criteria, refused)
    if search.chosen:
        search.remove_useless()
        search.add_all()
        search.remove_unproven()
    for _ in range(_ROUNDS):
        search.add_all()
        if not (search.remove_idle() or search.swap_better()):
            break
    return Selection(tuple(search.chosen), search.refused, criteria)


class _Search:
    """The effects chosen so far, and the gain of every other one beside them."""

    def __init__(self, criteria: Criteria,
                 refused: Mapping[tuple[str, int | None], str]) -> None:
        self.criteria = criteria
        self.fits = criteria.fits
        self.chosen = criteria.start(refused)
        self.refused = dict(refused)
        self._gains: dict[int, Gain] = {}
        # Effects of the arm whose gain is that beside fewer effects of joints.
        self._old: set[int] = set()
        self._stale = False

    def remove_useless(self) -> None:
        """
        Drop what takes nothing off the held-out error.

        Proof is asked for later: a small friction that is no finding of its own is a nuisance
        term until then, and keeps the others from bending towards it.
        """
        self._remove_all(lambda c: -self.criteria.gain_beside(c, self._without(c)).mean, 0.0)

    def remove_unproven(self) -> None:
        """Drop what chance may explain."""
        self._remove_all(lambda c: self.criteria.need(c, self._without(c)),
                         self.criteria.options.alpha)

    def _remove_all(self, fault: Callable[[Candidate], float], limit: float) -> None:
        """
        Drop what has a fault of a limit or more, or is not physical, the worst of each joint.

        Effects of one joint hide each other; those of others touch it by gravity and motion
        alone. So faults of other joints are worked out again only once nothing idle is left.
        """
        faults: dict[int, float] = {}
        while self.chosen:
            new = [c for c in self.chosen if id(c) not in faults]
            faults.update({id(c): fault(c) for c in new})
            idle = [c for c in self.chosen if faults[id(c)] >= limit
                    or not self.criteria.is_physical(c, self.chosen)]
            if idle:
                worst = _worst_of_each_joint(idle, faults)
                joints = {c.acts_on for c in worst}
                self._change([c for c in self.chosen if c not in worst])
                faults = {id(c): faults[id(c)] for c in self.chosen
                          if not joints & {None, c.acts_on} and not c.shared}
            elif len(new) < len(self.chosen):
                faults.clear()
            else:
                break

    def add_all(self) -> None:
        """Add effects as long as one pays."""
        while len(self.chosen) < self.criteria.options.most and (
                self.add_best() or self.add_best_afresh()):
            pass

    def add_best(self) -> bool:
        """Add the simplest of the best effects; return False if none pays."""
        gains, criteria = self._all_gains(), self.criteria
        passed: set[int] = set()
        while True:
            paying = [c for c in self._open() if id(c) not in passed
                      and gains[id(c)].p < criteria.options.alpha
                      and gains[id(c)].share > criteria.least_share(c)]
            if not paying:
                return False
            best = max(paying, key=lambda c: gains[id(c)].mean)
            alike = [c for c in paying if _is_alike(c, best, gains)]
            if any(id(c) in self._old for c in alike):
                self._renew([c for c in alike if id(c) in self._old])
                continue
            taken = min(alike, key=lambda c: (c.complexity, -gains[id(c)].mean))
            reason = criteria.implausible(
                taken, self.fits.coefficients(taken, [*self.chosen, taken]))
            if reason is None and criteria.is_more_than_motion(taken, self.chosen):
                self._change([*self.chosen, taken])
                return True
            if reason is not None:
                self.refused[taken.key] = reason
            passed.add(id(taken))

    def add_best_afresh(self) -> bool:
        """Do the same with gains beside what was added on other joints since."""
        if not self._stale:
            return False
        self._gains.clear()
        self._old.clear()
        self._stale = False
        return self.add_best()

    def remove_idle(self) -> bool:
        """
        Drop a chosen effect that the others have made needless, or that is not physical.

        So with one that corrects another which is not there any more.
        """
        # What corrects another effect goes before it.
        for candidate in sorted(self.chosen, key=lambda c: not c.effect.corrects):
            rest = self._without(candidate)
            if not (self.criteria.has_parent(candidate, {c.key for c in rest})
                    and self.criteria.is_needed(candidate, rest)):
                self._change(rest)
                return True
            if candidate.effect.certain and not self.criteria.is_physical(candidate, self.chosen):
                self.refused[candidate.key] = 'it is not physical beside what else was found'
                self._change(rest)
                return True
        return False

    def _without(self, candidate: Candidate) -> list[Candidate]:
        return [c for c in self.chosen if c is not candidate]

    def swap_better(self) -> bool:
        """Replace a chosen effect by one that explains more, or as much more simply."""
        criteria = self.criteria
        for candidate in list(self.chosen):
            rest = [c for c in self.chosen if c is not candidate]
            others = criteria.replacements(candidate, self.chosen, self.refused)
            for other, now, then in criteria.with_each_instead(candidate, others, self.chosen):
                if other.complexity < candidate.complexity:
                    pays = within_standard_error(now, then)
                else:
                    pays = not within_standard_error(then, now)
                if (pays and criteria.is_physical(other, [*rest, other])
                        and criteria.is_needed(other, rest)
                        and criteria.is_more_than_motion(other, rest)):
                    self._change([*rest, other])
                    return True
        return False

    def _open(self) -> list[Candidate]:
        return self.criteria.open(self.chosen, self.refused)

    def _all_gains(self) -> dict[int, Gain]:
        """Return the gain of every candidate that may be added, those not yet known made now."""
        missing = [c for c in self._open() if id(c) not in self._gains]
        self._gains.update({id(c): _NO_GAIN for c in missing})
        self._renew(self.criteria.promising(missing, self.chosen))
        return self._gains

    def _renew(self, candidates: list[Candidate]) -> None:
        """Work out gains beside what is chosen now."""
        places: list[int | None] = [None, *range(self.fits.n_joints)]
        for place in places:
            here = [c for c in candidates if c.acts_on == place]
            if not here:
                continue
            before = self.fits.errors(place, self.chosen)
            for c, after in zip(here, self.fits.errors_with_each(place, self.chosen, here)):
                self._gains[id(c)] = self.criteria.gain_of(c, before, after, self.chosen)
                self._old.discard(id(c))

    def _change(self, chosen: list[Candidate]) -> None:
        """Take a set of effects; forget the gains that it has changed."""
        before, now = {id(c): c for c in self.chosen}, {id(c): c for c in chosen}
        moved = [c for key, c in {**before, **now}.items() if (key in before) != (key in now)]
        self.chosen, self._stale = chosen, True
        if any(c.shared for c in moved):
            self._gains.clear()
            self._old.clear()
            return
        joints = {c.joint for c in moved}
        for c in self.criteria.candidates:
            if c.shared:
                self._old.add(id(c))
            elif c.joint in joints:
                self._gains.pop(id(c), None)


def _worst_of_each_joint(idle: Sequence[Candidate],
                         faults: Mapping[int, float]) -> list[Candidate]:
    """Return the idle effect with the largest fault of each joint, or alone if it is shared."""
    ordered = sorted(idle, key=lambda c: -faults[id(c)])
    if ordered[0].shared:
        return ordered[:1]
    return list({c.joint: c for c in reversed(ordered) if not c.shared}.values())


def _is_alike(candidate: Candidate, best: Candidate, gains: Mapping[int, Gain]) -> bool:
    """Return whether a candidate explains as much as the best within one standard error."""
    if candidate is best:
        return True
    if candidate.joint != best.joint and not (candidate.shared or best.shared):
        return False
    d = gains[id(best)].blocks - gains[id(candidate)].blocks
    return bool(d.mean() <= d.std(ddof=1) / np.sqrt(len(d)))
