"""Acceptance criteria of an effect: statistical evidence, physical size, arm dynamics."""

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
# Effects that most moving joints have.
STANDARD_TERMS = ('coulomb_friction', 'viscous_friction', 'torque_offset')
# Minimum reduction of the squared error of the fit to all data, relative to the reduction of the
# held-out error that is required. Held-out errors are computed above it.
_PROMISING = 0.25
# Minimum reduction by an alternative, relative to that of the effect it replaces.
_COMPARABLE = 0.5
# Number of columns above which a rare effect can be a substitute for several effects.
MAX_COLUMNS = 8
# Effects of a joint that gravity can absorb; a rare effect may then be their substitute.
_ABSORBABLE = ('torque_offset', 'joint_spring')
# (candidate, coefficients in its own units) -> reason why they are not physical, or None.
Implausible = Callable[[Candidate, FloatArray], 'str | None']


@dataclass(frozen=True, eq=False)
class Criteria:
    """
    Acceptance criteria, given the fits, the candidates and the options.

    `given` are the effects that the model includes already: name and joint.
    """

    fits: Fits
    candidates: tuple[Candidate, ...]
    implausible: Implausible
    options: SelectionOptions = SelectionOptions()
    given: frozenset[Key] = frozenset()

    @cached_property
    def _n_tried(self) -> Counter[str]:
        return Counter({c.key: c.effect.expectation for c in self.candidates}.values())

    @cached_property
    def _dynamics(self) -> list[Candidate]:
        # The last setting of a dynamic effect has the most columns.
        return list({c.key: c for c in self.candidates if _is_dynamics(c)}.values())

    def n_tests(self, trial: AnyTrial) -> float:
        """
        Return the factor that corrects a p-value for multiple testing.

        Weighted Bonferroni correction: dynamics, common effects and rare effects each get the
        same share of the family-wise error rate (Genovese et al., Biometrika 93, 2006).
        """
        return len(self._n_tried) * self._n_tried[trial.regressor.expectation] * trial.tried

    def gain_of(self, trial: AnyTrial, before: FloatArray, after: FloatArray,
                rest: Sequence[AnyTrial]) -> Gain:
        """
        Return the gain of an effect in addition to `rest`.

        Dynamics are tested by `gain_of_fast_motion`, since few blocks have fast motion. If an
        effect removes a large share of the held-out error, the t-test of its coefficient is
        evidence as well: a short recording has few blocks, and their gains differ with the
        excitation in each (a cable is slack over half of the range), while the coefficient is
        precise.
        """
        tests = self.n_tests(trial)
        if trial.regressor.expectation == Expectation.MOTION:
            return gain_of_fast_motion(before, after, tests)
        result = gain(before, after, tests)
        standard = trial.regressor.name in STANDARD_TERMS
        if result.share < (self.options.evident_share if standard else
                           self.options.evident_rare_share):
            return result
        if standard:
            tests = float(len(self._n_tried))
            result = gain(before, after, tests)
        if result.p >= self.options.alpha and len(trial.columns) == 1:
            p = 2.0 * tests * p_of_size(self.fits, [*rest, trial], trial)
            result = replace(result, p=min(result.p, p))
        return result

    def min_share(self, trial: AnyTrial) -> float:
        """Return the minimum share of the error to remove; shared effects act on all joints."""
        return self.options.min_share / (self.fits.n_joints if trial.shared else 1)

    def gain_given(self, candidate: Candidate, rest: Sequence[AnyTrial]) -> Gain:
        """Return the gain of an effect in addition to the rest."""
        joint = candidate.acts_on
        after, = self.fits.errors_with_each(joint, rest, [candidate])
        return self.gain_of(candidate, self.fits.errors(joint, rest), after, rest)

    def promising(self, candidates: Sequence[Candidate],
                  chosen: Sequence[Candidate]) -> list[Candidate]:
        """Return the candidates that reduce the error of the fit to all data enough to test."""
        if not candidates:
            return []
        errors = self.fits.errors(None, chosen).sum(axis=0)
        each = self.fits.explained_by_each(chosen, candidates)
        return [c for c, part in zip(candidates, each) if part >= _PROMISING * self.min_share(c)
                * float(errors.sum() if c.shared else errors[c.joint_index])]

    def is_needed(self, candidate: Candidate, rest: Sequence[AnyTrial]) -> bool:
        """Return whether an effect is significant in addition to the rest."""
        return self.p_value(candidate, rest) < self.options.alpha

    def p_value(self, candidate: Candidate, rest: Sequence[AnyTrial]) -> float:
        """Return the p-value of an effect given the rest; 1 if its gain is negligible."""
        result = self.gain_given(candidate, rest)
        return result.p if result.share >= 0.5 * self.min_share(candidate) else 1.0

    def exceeds_dynamics(self, trial: AnyTrial, chosen: Sequence[Candidate]) -> bool:
        """
        Return whether a rare effect explains more than inertia and Coriolis torque.

        Every moving arm has dynamics, and a few columns describe them incompletely; a rare effect
        must not absorb them. A nonlinear friction law must explain more than viscous friction
        and presliding together, which also reduce friction at low speed. Common effects need no
        such test.
        """
        if trial.regressor.expectation != Expectation.RARE:
            return True
        dynamics = [c for c in self._dynamics
                    if c not in chosen and (trial.shared or c.joint == trial.joint)]
        joint = trial.acts_on
        rest = [*chosen, *dynamics, *self._simpler_speed_laws(trial, chosen)]
        before = self.fits.errors(joint, rest)
        after, = self.fits.errors_with_each(joint, rest, [trial])
        if self.gain_of(trial, before, after, rest).p >= self.options.alpha:
            return False
        shares = [share(before[:, [n]], after[:, [n]]) for n in range(before.shape[1])]
        if trial.joint is None and (len(trial.columns) > MAX_COLUMNS or
                                    self._absorbs_nuisance_term(int(np.argmax(shares)))):
            # On that joint it may be a substitute, so another joint must show it.
            shares.remove(max(shares))
        return max(shares, default=0.0) >= self.options.min_rare_share

    def _absorbs_nuisance_term(self, joint: int) -> bool:
        """Return whether gravity absorbs a spring or an offset of a joint in this motion."""
        if ('joint_spring', joint) in self.fits.layout.untestable:
            return True
        return any(1.0 - self.fits.absorbed(c) < self.options.min_unabsorbed_nuisance ** 2
                   for c in self.candidates if c.joint == joint and c.effect.name in _ABSORBABLE)

    def _simpler_speed_laws(self, trial: AnyTrial, chosen: Sequence[Candidate]) -> list[Candidate]:
        """Return the simpler effects, not chosen, that a nonlinear friction law must exceed."""
        if not isinstance(trial, Candidate) or not trial.effect.is_nonlinear_in_speed:
            return []
        keys = {c.key for c in chosen} | {trial.key}
        here = {c.key: c for c in reversed(self.candidates) if c.joint == trial.joint}
        return [here[name, trial.joint] for name in ('viscous_friction', 'presliding_hysteresis')
                if (name, trial.joint) in here and (name, trial.joint) not in keys]

    def is_physical(self, candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
        """Return whether the coefficients of a chosen effect are physically possible."""
        return self.unphysical(candidate, chosen) is None

    def unphysical(self, candidate: Candidate, chosen: Sequence[Candidate]) -> str | None:
        """Return why the coefficients of a chosen effect are not physical, or None."""
        return self.implausible(candidate, self.fits.coefficients(candidate, chosen))

    def initial(self, refused: Collection[Key]) -> list[Candidate]:
        """
        Return the effects with which the search starts.

        It is the model of rigid-body identification: dynamics of the arm, friction and offset of
        each joint. In fast motion these terms mask each other, so they are first fitted jointly;
        insignificant and unphysical ones are removed. Without a model of the arm's dynamics the
        search starts with no effect.
        """
        every = {c.key: c for c in self.candidates if c.key not in refused}
        certain = [c for c in every.values() if c.effect.certain]
        return [*certain, *(c for c in every.values() if c.effect.name in STANDARD_TERMS)] \
            if certain else []

    def available(self, chosen: Sequence[Candidate], refused: Collection[Key]) -> list[Candidate]:
        """Return the candidates that can be added; only one model of the dynamics is allowed."""
        keys = {c.key for c in chosen}
        has_dynamics = any(c.effect.certain for c in chosen)
        return [c for c in self.candidates if c.key not in keys and c.key not in refused
                and self.has_parent(c, keys) and not (has_dynamics and _is_dynamics(c))]

    def available_on(self, joint: int, chosen: Sequence[Candidate],
                     refused: Collection[Key]) -> list[Candidate]:
        """Return the physical effects of one joint that are not chosen."""
        return [c for c in self.available(chosen, refused) if c.joint == joint and not c.shared
                and self.is_physical(c, [*chosen, c])]

    def replacements(self, candidate: Candidate, chosen: Sequence[Candidate],
                     refused: Collection[Key]) -> list[Candidate]:
        """Return possible replacements of a chosen effect, on its joint or on the whole arm."""
        keys = {c.key for c in chosen if c is not candidate}
        return [c for c in self.candidates if c is not candidate
                and c.key not in keys and c.key not in refused
                and self.has_parent(c, keys)
                and (c.joint == candidate.joint or c.shared or candidate.shared)]

    def with_each_replacement(self, candidate: Candidate, others: Sequence[Candidate],
                              chosen: Sequence[Candidate]
                              ) -> Iterator[tuple[Candidate, FloatArray, FloatArray]]:
        """
        Yield each replacement, the errors with the chosen effect, and with the replacement.

        Errors are those of the common joint, or of all joints if either acts on more.
        Replacements that explain much less of the training data are skipped.
        """
        rest = [c for c in chosen if c is not candidate]
        own, *each = self.fits.explained_by_each(rest, [candidate, *others])
        others = [c for c, part in zip(others, each) if part >= _COMPARABLE * own]
        joints = {id(c): None if c.shared else candidate.acts_on for c in others}
        after: dict[int, FloatArray] = {}
        for joint in set(joints.values()):
            here = [c for c in others if joints[id(c)] == joint]
            after.update(zip(map(id, here), self.fits.errors_with_each(joint, rest, here)))
        return ((c, self.fits.errors(joints[id(c)], chosen), after[id(c)]) for c in others)

    def has_parent(self, candidate: Candidate, keys: set[Key]) -> bool:
        """Return whether one of the effects that a candidate corrects is on its joint."""
        required, present = candidate.effect.corrects, keys | self.given
        return not required or any((name, candidate.joint) in present for name in required)


def _is_dynamics(candidate: Candidate) -> bool:
    return candidate.effect.expectation == Expectation.MOTION
