"""When an effect counts beside others: by evidence, by physics, and by what a moving arm has."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.candidates import AnyTrial, Candidate
from gravity_comp_ros.diagnosis.estimates import p_of_size
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.diagnosis.options import SelectionOptions
from gravity_comp_ros.effects.effect import Expectation
from gravity_comp_ros.evaluation.gain import Gain, gain, gain_of_fast_motion, share
import numpy as np

Key = tuple[str, int | None]
# What a moving joint usually has.
USUAL = ('coulomb_friction', 'viscous_friction', 'torque_offset')
# A candidate that takes less than this part of what is asked for off the fit to all data does
# not take that off the held-out error, or off that of a typical block.
_PROMISING = 0.25
# An alternative explains at least this part of what an effect explains in its place.
_COMPARABLE = 0.5
# Effects of a joint that gravity may hide, and for which something rare then stands.
_HIDDEN = ('torque_offset', 'joint_spring')
# (candidate, coefficients in its own units) -> why they are not physical, or None.
Implausible = Callable[[Candidate, FloatArray], 'str | None']


@dataclass(frozen=True, eq=False)
class Criteria:
    """
    What an effect must pass, given the fits, the candidates and the options.

    `given` are the effects that the gravity model has already: name and joint.
    """

    fits: Fits
    candidates: tuple[Candidate, ...]
    implausible: Implausible
    options: SelectionOptions = SelectionOptions()
    given: frozenset[Key] = frozenset()

    @cached_property
    def _tried(self) -> Counter[str]:
        return Counter({c.key: c.effect.expectation for c in self.candidates}.values())

    @cached_property
    def _dynamics(self) -> list[Candidate]:
        # The last form of an effect of motion has the most columns.
        return list({c.key: c for c in self.candidates if _moves(c)}.values())

    def tests(self, trial: AnyTrial) -> float:
        """
        Return the factor by which a p-value is corrected for what was tried.

        The weighted Bonferroni correction: what moves, what is expected in every joint and all
        the rest get the same part of the chance of a false alarm (Genovese et al., Biometrika
        93, 2006).
        """
        return len(self._tried) * self._tried[trial.regressor.expectation] * trial.tried

    def gain_of(self, trial: AnyTrial, before: FloatArray, after: FloatArray,
                rest: Sequence[AnyTrial]) -> Gain:
        """
        Return the gain beside others; what fast motion needs shows in the few blocks that have it.

        Where something takes much off the held-out error, its size is evidence as well: blocks
        gain as much as each of them has of it, and a short recording has few, so that their
        gains differ widely while the coefficient is certain. A cable that is slack over half of
        the range gains nothing there.
        """
        if trial.regressor.expectation == Expectation.MOTION:
            return gain_of_fast_motion(before, after, self.tests(trial))
        tests = self.tests(trial)
        found = gain(before, after, tests)
        usual = trial.regressor.name in USUAL
        if found.share < (self.options.evident_share if usual else
                          self.options.evident_rare_share):
            return found
        if usual:
            tests = float(len(self._tried))
            found = gain(before, after, tests)
        if found.p >= self.options.alpha and len(trial.columns) == 1:
            p = 2.0 * tests * p_of_size(self.fits, [*rest, trial], trial)
            found = replace(found, p=min(found.p, p))
        return found

    def least_share(self, trial: AnyTrial) -> float:
        """Return the share of the error that must go; shared effects count on all joints."""
        return self.options.least_share / (self.fits.n_joints if trial.shared else 1)

    def gain_beside(self, candidate: Candidate, rest: Sequence[AnyTrial]) -> Gain:
        """Return the gain of an effect beside others."""
        joint = candidate.acts_on
        after, = self.fits.errors_with_each(joint, rest, [candidate])
        return self.gain_of(candidate, self.fits.errors(joint, rest), after, rest)

    def promising(self, candidates: Sequence[Candidate],
                  chosen: Sequence[Candidate]) -> list[Candidate]:
        """Return the candidates that take enough off the fit to all data to be looked at."""
        if not candidates:
            return []
        errors = self.fits.errors(None, chosen).sum(axis=0)
        each = self.fits.explained_by_each(chosen, candidates)
        return [c for c, part in zip(candidates, each) if part >= _PROMISING * self.least_share(c)
                * float(errors.sum() if c.shared else errors[c.place])]

    def is_needed(self, candidate: Candidate, rest: Sequence[AnyTrial]) -> bool:
        """Return whether an effect pays beside the rest of what is chosen."""
        return self.need(candidate, rest) < self.options.alpha

    def need(self, candidate: Candidate, rest: Sequence[AnyTrial]) -> float:
        """Return the p-value of an effect beside the rest; 1 if it takes next to nothing off."""
        kept = self.gain_beside(candidate, rest)
        return kept.p if kept.share >= 0.5 * self.least_share(candidate) else 1.0

    def is_more_than_motion(self, trial: AnyTrial, chosen: Sequence[Candidate]) -> bool:
        """
        Return whether something rare explains much that no inertia or Coriolis torque does.

        Every arm that moves has those, named or not, and no few columns describe all of them;
        what it explains of them is not its own. A law of speed must explain more than viscous
        friction does with what builds up at reversals, which makes friction smaller at low
        speed. What is expected in every joint needs no such proof.
        """
        if trial.regressor.expectation != Expectation.RARE:
            return True
        moving = [c for c in self._dynamics
                  if c not in chosen and (trial.shared or c.joint == trial.joint)]
        joint = trial.acts_on
        beside = [*chosen, *moving, *self._simpler_laws(trial, chosen)]
        before = self.fits.errors(joint, beside)
        after, = self.fits.errors_with_each(joint, beside, [trial])
        if self.gain_of(trial, before, after, beside).p >= self.options.alpha:
            return False
        shares = [share(before[:, [n]], after[:, [n]]) for n in range(before.shape[1])]
        if trial.joint is None and self._hides_something(int(np.argmax(shares))):
            # On that joint it may stand for what is hidden, so another one must show it.
            shares.remove(max(shares))
        return max(shares, default=0.0) >= self.options.least_rare_share

    def _hides_something(self, joint: int) -> bool:
        """Return whether a spring or an offset of a joint would not show in this motion."""
        if ('joint_spring', joint) in self.fits.layout.untestable:
            return True
        return any(1.0 - self.fits.absorbed(c) < self.options.least_shown ** 2
                   for c in self.candidates if c.joint == joint and c.effect.name in _HIDDEN)

    def _simpler_laws(self, trial: AnyTrial, chosen: Sequence[Candidate]) -> list[Candidate]:
        """Return the effects, not chosen, that a law of speed must pay beside."""
        if not isinstance(trial, Candidate) or not trial.effect.bends_with_speed:
            return []
        taken = {c.key for c in chosen} | {trial.key}
        here = {c.key: c for c in reversed(self.candidates) if c.joint == trial.joint}
        return [here[name, trial.joint] for name in ('viscous_friction', 'presliding_hysteresis')
                if (name, trial.joint) in here and (name, trial.joint) not in taken]

    def is_physical(self, candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
        """Return whether the coefficients of a chosen effect can be those of an arm."""
        return self.unphysical(candidate, chosen) is None

    def unphysical(self, candidate: Candidate, chosen: Sequence[Candidate]) -> str | None:
        """Return why the coefficients of a chosen effect are not those of an arm, or None."""
        return self.implausible(candidate, self.fits.coefficients(candidate, chosen))

    def start(self, refused: Collection[Key]) -> list[Candidate]:
        """
        Return the effects that the search starts with.

        An arm of rigid bodies needs torque for its motion, and friction and offset of each joint
        are usual beside it: that is the model of rigid-body identification. Its parts hide each
        other in fast motion, so that they are looked at all together; what does not pay beside the
        others, or is not physical, is dropped. Without a description of the robot there is no such
        model, and the search starts with nothing.
        """
        every = {c.key: c for c in self.candidates if c.key not in refused}
        certain = [c for c in every.values() if c.effect.certain]
        return [*certain, *(c for c in every.values() if c.effect.name in USUAL)] \
            if certain else []

    def open(self, chosen: Sequence[Candidate], refused: Collection[Key]) -> list[Candidate]:
        """Return the candidates that may be added; motion is described once."""
        taken = {c.key for c in chosen}
        moves = any(c.effect.certain for c in chosen)
        return [c for c in self.candidates if c.key not in taken and c.key not in refused
                and self.has_parent(c, taken) and not (moves and _moves(c))]

    def open_on(self, joint: int, chosen: Sequence[Candidate],
                refused: Collection[Key]) -> list[Candidate]:
        """Return the physical effects of one joint that are not chosen."""
        return [c for c in self.open(chosen, refused) if c.joint == joint and not c.shared
                and self.is_physical(c, [*chosen, c])]

    def replacements(self, candidate: Candidate, chosen: Sequence[Candidate],
                     refused: Collection[Key]) -> list[Candidate]:
        """Return the alternatives to a chosen effect, on its joint or on the arm."""
        taken = {c.key for c in chosen if c is not candidate}
        return [c for c in self.candidates if c is not candidate
                and c.key not in taken and c.key not in refused
                and self.has_parent(c, taken)
                and (c.joint == candidate.joint or c.shared or candidate.shared)]

    def with_each_instead(self, candidate: Candidate, others: Sequence[Candidate],
                          chosen: Sequence[Candidate]
                          ) -> Iterator[tuple[Candidate, FloatArray, FloatArray]]:
        """
        Return, for each of the others, the errors with a chosen effect and with that instead.

        On the joint of both, or on all joints if either acts on more. Those that explain far less
        even of the data that they are fitted to are left out.
        """
        rest = [c for c in chosen if c is not candidate]
        own, *each = self.fits.explained_by_each(rest, [candidate, *others])
        others = [c for c, part in zip(others, each) if part >= _COMPARABLE * own]
        joints = {id(c): None if c.shared else candidate.acts_on for c in others}
        then: dict[int, FloatArray] = {}
        for joint in set(joints.values()):
            here = [c for c in others if joints[id(c)] == joint]
            then.update(zip(map(id, here), self.fits.errors_with_each(joint, rest, here)))
        return ((c, self.fits.errors(joints[id(c)], chosen), then[id(c)]) for c in others)

    def has_parent(self, candidate: Candidate, taken: set[Key]) -> bool:
        """Return whether an effect that corrects another has one to correct."""
        corrects, there = candidate.effect.corrects, taken | self.given
        return not corrects or any((name, candidate.joint) in there for name in corrects)


def _moves(candidate: Candidate) -> bool:
    return candidate.effect.expectation == Expectation.MOTION
