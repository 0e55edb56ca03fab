"""Plan of a motion that resolves open targets: candidates, selection, expected results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.effects.request import known_effect
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.estimate import Estimate, estimate, FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.candidates import candidates, of_all_joints, Part
from gravity_comp_ros.planning.criterion import (
    coefficients, Criterion, evidence_after, GravityQuestion, identified, Question)
from gravity_comp_ros.planning.expected import (
    Expectation, GravityExpectation, MotionPlan, PlannedPart)
from gravity_comp_ros.planning.options import GRAVITY, PlanOptions, Target
from gravity_comp_ros.planning.questions import MAX_TARGETS, open_targets, questions_of
from gravity_comp_ros.planning.segments import Limits, sampled, Segment
from gravity_comp_ros.planning.selection import Selector, untestable
from gravity_comp_ros.planning.sums import PlannedMotion, Sums
from gravity_comp_ros.planning.workspace import Obstacles, Workspace, workspace
import numpy as np

Progress = Callable[[str, float], None]

# With targets on more joints than this, tours of all joints are candidates.
_MAX_JOINTS_WITHOUT_TOURS = 3
# Nominal duration of a part: a share of the whole duration, within limits in s.
_NOMINAL_SHARE, _MIN_NOMINAL, _MAX_NOMINAL = 0.25, 3.0, 8.0
# Parts of each joint in the probe motion, from which priors and settings follow.
_PROBE_PARTS = 6
# Family of effects that need the ends of a joint's travel to be distinguished from gravity.
_ELASTIC = 'elastic'
# Quantile of a joint's speed that counts as its top speed; smallest speed limit, rad/s.
_TOP_QUANTILE, _MIN_SPEED = 0.98, 0.03
# Half-width of a 95 % interval in standard deviations.
_Z95 = 1.96


def plan(samples: JointSamples, model: GravityModel, targets: Sequence[Target] | None = None,
         options: PlanOptions = PlanOptions(), diagnosis: Diagnosis | None = None,
         progress: Progress | None = None, obstacles: Obstacles | None = None,
         estimated: Estimate | None = None) -> MotionPlan:
    """
    Return the motion of largest utility for the targets, within the limits.

    :param samples: all samples of earlier recordings, fast ones included.
    :param targets: effects to resolve; None for the open findings of the diagnosis, or without
        one for the open terms of the estimate.
    :param obstacles: collision check of poses.
    :param estimated: estimate of the same samples and joints; computed if it is not given.
    :raises OptionError: if nothing is open, a target is unknown, or no admissible motion excites
        any target.
    """
    report = progress or (lambda stage, share: None)
    samples = samples.joints(model.joints)
    space = workspace(samples, options, obstacles)
    report('plan', 0.0)
    if estimated is None:
        estimated = estimate(samples, FitOptions(model.formulation, geometry=model.geometry),
                             old=model)
    report('plan', 0.3)
    task = _task(PlannedMotion(estimated.regression), space, model, targets, options, diagnosis)
    report('plan', 0.5)
    chosen = task.selector.select()
    if not chosen:
        raise OptionError(f'plan: within these limits no motion of {options.duration:g} s adds '
                          f'enough information to the recordings: raise the duration, the speed '
                          f'or the reach, or widen the position limits')
    motion, times = task.selector.assemble(chosen)
    t, (q, qd, qdd) = sampled(motion, options.rate)
    added = task.criterion.sums.added([motion])[0]
    expected = task.expectations(motion, added)
    report('plan', 1.0)
    notes = (*task.notes, *(_unlikely(each) for each in expected if not each.is_likely))
    return MotionPlan(Trajectory(model.joints, t, q, qd, qdd), task.planned_parts(times, chosen),
                      expected, notes, task.gravity_expectations(added))


@dataclass(frozen=True, eq=False)
class _Task:
    """The criterion of a motion, and its selector."""

    joints: tuple[str, ...]
    criterion: Criterion
    selector: Selector
    notes: tuple[str, ...]

    @property
    def sums(self) -> Sums:
        return self.criterion.sums

    def expectations(self, motion: Sequence[Segment], added: FloatArray
                     ) -> tuple[Expectation, ...]:
        """Return the expected result of each effect after a motion with sums (L, L)."""
        reasons = untestable(self.criterion, motion, self.sums.recorded + added)
        return tuple(self._expectation(question, added, reason)
                     for question, reason in zip(self.criterion.questions, reasons))

    def _expectation(self, question: Question, added: FloatArray, reason: str) -> Expectation:
        sums, term = self.sums, question.term
        regression = sums.planned.regression
        limits = regression.problem.options.min_gain, regression.problem.options.margin
        after = evidence_after(sums, question, added)
        before = evidence_after(sums, question, 0.0 * added)
        unseen = (term.key in regression.candidates.untestable or identified(
            sums, question, sums.recorded) < regression.problem.options.min_identified)
        places = sums.with_shared((*question.base, term))
        _, covariance = coefficients(sums, places, sums.recorded + added, sums.score)
        std = np.sqrt(np.diag(covariance)[-term.n_columns:])
        share = identified(sums, question, sums.recorded + added)
        listed = term.effect.coefficients_of(regression.motion, term.joint_number, term.setting)
        # A coefficient that the other terms absorb is not published.
        widths = {c.symbol: (_Z95 * float(s) if not reason else np.inf, c.unit)
                  for c, s in zip(listed, std)}
        size = question.mean if question.is_measured else term.prior_std
        return Expectation(
            question.target, 0.0 if unseen else before.chance(*limits),
            0.0 if reason else after.chance(*limits), widths,
            '' if after.closest is None else after.closest.name,
            {c.symbol: float(x) for c, x in zip(listed, size)}, question.is_measured,
            float(np.median(after.gain)), float(np.median(before.separation)),
            float(np.median(after.separation)), reason, share)

    def gravity_expectations(self, added: FloatArray) -> tuple[GravityExpectation, ...]:
        """Return the standard deviations of the uncertain joints before and after the motion."""
        gravity = self.criterion.gravity
        if gravity is None:
            return ()
        after = gravity.std_after(self.sums, (self.sums.recorded + added)[None])[0]
        return tuple(GravityExpectation(self.joints[n], float(gravity.std[n]), float(after[n]))
                     for n in gravity.joints)

    def planned_parts(self, times: Sequence[tuple[float, float]],
                      chosen: Sequence[Part]) -> tuple[PlannedPart, ...]:
        """Return descriptions of the parts; equal consecutive parts are one."""
        names = [question.target.name for question in self.criterion.questions] + [GRAVITY]
        parts: list[PlannedPart] = []
        for (start, end), part in zip(times, chosen):
            one = PlannedPart(start, end, tuple(self.joints[n] for n in part.joints), part.what,
                              tuple(names[k] for k in self.selector.informs(part)))
            if parts and replace(one, start=0.0, end=0.0) == replace(parts[-1], start=0.0,
                                                                     end=0.0):
                one = replace(one, start=parts.pop().start)
            parts.append(one)
        return tuple(parts)


def _task(planned: PlannedMotion, space: Workspace, model: GravityModel,
          targets: Sequence[Target] | None, options: PlanOptions,
          diagnosis: Diagnosis | None) -> _Task:
    regression = planned.regression
    gravity_named = targets is not None and any(t.effect == GRAVITY for t in targets)
    gravity = None
    if targets is None or gravity_named:
        gravity = GravityQuestion.of(Sums(planned, regression.terms, options.duration),
                                     gravity_named)
    if targets is None:
        targets = open_targets(regression, diagnosis)[:MAX_TARGETS - (gravity is not None)]
    targets = [target for target in targets if target.effect != GRAVITY]
    if not targets and gravity is None:
        raise OptionError('plan: no target is open; name the effects to resolve')
    limits = _limits(options, targets, regression.problem.samples)
    parts = _candidates(space, model, targets, gravity, limits, options)
    if not parts:
        raise OptionError('plan: within the limits no joint of the targets can move; the '
                          'recorded range may be too narrow')
    by_joint = {part.joints: [p for p in parts if p.joints == part.joints][:_PROBE_PARTS]
                for part in parts}
    probe = [s for some in by_joint.values() for part in some for s in part.segments]
    sums, questions, notes = questions_of(planned, targets, probe, options.duration, diagnosis)
    if gravity is not None:
        gravity = replace(gravity, places=sums.with_shared(regression.terms))
    criterion = Criterion(sums, tuple(questions), gravity)
    return _Task(model.joints, criterion,
                 Selector(space, criterion, parts, limits, options.duration), tuple(notes))


def _limits(options: PlanOptions, targets: Sequence[Target], samples: JointSamples) -> Limits:
    """
    Return the limits of speed, acceleration and jerk.

    An effect that changes with time is identified at the speeds of the earlier motion only. At
    other speeds its change mixes with that of friction by speed, and may cancel it.
    """
    limits = Limits(options.max_speed, options.max_acceleration, options.max_jerk)
    changing = [list(samples.names).index(target.joint) for target in targets
                if target.joint in samples.names
                and 'origin' in known_effect(target.effect).setting_units]
    if not changing:
        return limits
    top = np.quantile(np.abs(samples.qd[:, changing]), _TOP_QUANTILE, axis=0).max()
    return limits.slower(max(float(top), _MIN_SPEED))


def _candidates(space: Workspace, model: GravityModel, targets: Sequence[Target],
                gravity: GravityQuestion | None, limits: Limits,
                options: PlanOptions) -> list[Part]:
    names = list(model.joints)
    for target in targets:
        if target.joint is not None and target.joint not in names:
            raise OptionError(f'{target.name}: no joint {target.joint}; the joints are '
                              f'{", ".join(names)}')
    elsewhere = [other.partition(':')[2] for target in targets for other in target.alternatives]
    joints = [names.index(joint) for joint in (*(target.joint for target in targets), *elsewhere)
              if joint in names]
    if gravity is not None:
        joints += gravity.joints
    if any(target.joint is None for target in targets):
        joints += list(range(len(names)))
    nominal = float(np.clip(_NOMINAL_SHARE * options.duration, _MIN_NOMINAL, _MAX_NOMINAL))
    parts: list[Part] = []
    for joint in dict.fromkeys(joints):
        elastic = any(known_effect(target.effect).family == _ELASTIC for target in targets
                      if target.joint in (None, names[joint]))
        parts += candidates(space, model, joint, limits, nominal, elastic)
    if len(set(joints)) > _MAX_JOINTS_WITHOUT_TOURS:
        parts += of_all_joints(space, limits, options.duration)
    return parts


def _unlikely(expected: Expectation) -> str:
    if expected.untestable:
        return (f'{expected.target.name}: no part within these limits resolves it: '
                f'{expected.untestable}')
    against = (f' against {expected.closest_alternative}' if expected.closest_alternative else '')
    return (f'{expected.target.name}: the chance that this motion resolves it{against} is only '
            f'{100 * expected.chance:.0f} %; a longer or faster motion or more reach may resolve '
            f'it')
