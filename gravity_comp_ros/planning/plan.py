"""Plan of a motion that resolves open targets: candidates, selection, expected results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.diagnosis.diagnose import conclude
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.estimate import Estimate, estimate, FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.collision import SelfCollision
from gravity_comp_ros.planning.criterion import Criterion, Question, uncertain_joints
from gravity_comp_ros.planning.expected import (
    Expectation, GravityExpectation, MotionPlan, PlannedPart)
from gravity_comp_ros.planning.questions import (
    ambiguous_with, MAX_TARGETS, named_targets, open_targets, questions_of)
from gravity_comp_ros.planning.selection import Part, Selection, strokes
from gravity_comp_ros.planning.sums import joined, motion_of, Sums
from gravity_comp_ros.planning.workspace import PlanOptions, sampled, workspace
from gravity_comp_ros.regression.engine import Regression
from gravity_comp_ros.regression.term import Key
import numpy as np

Progress = Callable[[str, float], None]
# Name of the target that is not an effect: the gravity torque where it is uncertain.
GRAVITY = 'gravity'


def plan(samples: JointSamples, model: GravityModel, targets: Sequence[str] | None = None,
         options: PlanOptions = PlanOptions(), diagnosis: Diagnosis | None = None,
         progress: Progress | None = None, obstacles: SelfCollision | None = None,
         estimated: Estimate | None = None) -> MotionPlan:
    """
    Return the motion of largest utility for the targets, within the limits.

    :param samples: all samples of earlier recordings, fast ones included.
    :param targets: effects to resolve on every joint (`NAME`) or on one (`NAME:JOINT`), or
        `gravity`; None for the open findings of the diagnosis.
    :param diagnosis: that of the same estimate; concluded if it is not given.
    :param obstacles: collision check of poses.
    :param estimated: estimate of the same samples and joints; computed if it is not given.
    :raises OptionError: if nothing is open, a target is unknown, or no admissible motion excites
        any target.
    """
    report = progress or (lambda stage, share: None)
    samples = samples.joints(model.joints)
    named = None if targets is None else named_targets(
        [name for name in targets if name != GRAVITY], model.joints)
    space = workspace(samples, options, obstacles)
    report('plan', 0.0)
    if estimated is None:
        estimated = estimate(samples, FitOptions(model.formulation, geometry=model.geometry),
                             old=model)
    report('plan', 0.3)
    regression = estimated.regression
    joints = uncertain_joints(Sums(regression, regression.terms, options.duration),
                              targets is not None)
    if named is None:
        named = open_targets(regression, diagnosis or conclude(estimated, model))
        named = named[:MAX_TARGETS - bool(joints)]
    elif GRAVITY not in (targets or ()):
        joints = ()
    if not (named or joints):
        raise OptionError('no finding is open: name targets with --settle EFFECT:JOINT')
    parts = strokes(space, model, _joints(regression, named, joints), options)
    if not parts:
        raise OptionError('within the limits no joint of the targets can move; the '
                          'recorded range may be too narrow')
    # Priors and settings follow from all candidates as one motion.
    sums, questions, notes = questions_of(
        regression, named, [line for part in parts for line in part.lines], options.duration)
    report('plan', 0.5)
    selection = Selection(space, Criterion(sums, questions, joints), parts, options.duration)
    if not selection.parts:
        raise OptionError(f'within these limits no motion of {options.duration:g} s adds '
                          f'enough information to the recordings: raise the duration, the speed '
                          f'or the reach, or widen the position limits')
    motion, times = selection.motion()
    t, (q, qd, qdd) = sampled(motion, options.rate)
    added = sums.added([motion])[0]
    both = joined(regression, motion_of(regression, [motion]))
    expected = tuple(_expectation(question, both, added) for question in questions)
    report('plan', 1.0)
    notes += [_unlikely(one) for one in expected if not one.is_likely]
    before, after = sums.gravity_std(np.stack([sums.recorded, sums.recorded + added])).tolist()
    return MotionPlan(Trajectory(model.joints, t, q, qd, qdd),
                      _planned_parts(selection.parts, times, model.joints), expected,
                      tuple(notes), tuple(GravityExpectation(model.joints[n], before[n], after[n])
                                          for n in joints))


def _joints(regression: Regression, targets: Sequence[Key], uncertain: Sequence[int]
            ) -> list[int]:
    """Return uncertain joints, then those of targets and alternatives, all for the whole arm."""
    joints = [*uncertain]
    for key in targets:
        joints += range(regression.problem.samples.n_joints) if key[1] is None else [key[1]]
        joints += [joint for _, joint in ambiguous_with(regression, key) if joint is not None]
    return list(dict.fromkeys(joints))


def _expectation(question: Question, both: Motion, added: FloatArray) -> Expectation:
    """Return the expected result of a target after a motion with sums (L, L)."""
    regression, term, recorded = question.sums.regression, question.term, question.sums.recorded
    unseen = question.untestable(regression.motion, recorded)
    reason = question.untestable(both, recorded + added)
    (before, _), (after, closest) = question.chance(recorded), question.chance(recorded + added)
    listed = term.effect.coefficients_of(regression.motion, term.joint_number, term.setting)
    # A coefficient that the other terms absorb is not published.
    widths = np.where(bool(reason), np.inf, HALF_95 * question.std(recorded + added))
    joint = None if term.joint is None else regression.problem.samples.names[term.joint]
    return Expectation(
        term.name, joint, 0.0 if unseen else before, 0.0 if reason else after,
        {c.symbol: (float(width), c.unit) for c, width in zip(listed, widths)},
        '' if closest is None else closest.name,
        {c.symbol: float(x) for c, x in zip(listed, question.size)}, question.is_measured,
        reason, question.identified(recorded + added))


def _planned_parts(chosen: Sequence[Part], times: Sequence[tuple[float, float]],
                   names: tuple[str, ...]) -> tuple[PlannedPart, ...]:
    """Return descriptions of the parts; equal consecutive parts are one."""
    parts: list[PlannedPart] = []
    for (start, end), part in zip(times, chosen):
        one = PlannedPart(start, end, tuple(names[n] for n in part.joints), part.what)
        if parts and replace(parts[-1], start=start, end=end) == one:
            one = replace(one, start=parts.pop().start)
        parts.append(one)
    return tuple(parts)


def _unlikely(expected: Expectation) -> str:
    if expected.untestable:
        return (f'{expected.target}: no part within these limits resolves it: '
                f'{expected.untestable}')
    against = (f' against {expected.closest_alternative}' if expected.closest_alternative else '')
    return (f'{expected.target}: the chance that this motion resolves it{against} is only '
            f'{100 * expected.chance:.0f} %; a longer or faster motion or more reach may resolve '
            f'it')
