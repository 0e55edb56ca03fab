"""Plan of a motion that resolves open targets: candidates, selection, expected results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import evenly_picked, JointSamples
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.effects.motion import build_motion
from gravity_comp_ros.effects.request import known_effect
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.nuisance_columns import white_noise
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.candidates import candidates, of_all_joints, Part
from gravity_comp_ros.planning.context import DesignContext, DesignProblem
from gravity_comp_ros.planning.criterion import EffectScore, power
from gravity_comp_ros.planning.expected import (
    Expectation, GravityExpectation, Plan, PlannedPart)
from gravity_comp_ros.planning.gravity_uncertainty import (
    gravity_uncertainty, GravityScore, GravityUncertainty)
from gravity_comp_ros.planning.objectives import EffectObjective, GravityObjective, Objective
from gravity_comp_ros.planning.options import GRAVITY, PlanOptions, Target
from gravity_comp_ros.planning.segments import Limits, sampled, Segment
from gravity_comp_ros.planning.selection import Selector
from gravity_comp_ros.planning.targets import (
    auxiliary_targets, design_problem, MAX_TARGETS, observed_separation, open_targets,
    with_ambiguous_findings)
from gravity_comp_ros.planning.workspace import Obstacles, Workspace, workspace
import numpy as np

Progress = Callable[[str, float], None]

# Rows of the recordings that are used; sample rate of candidates, Hz.
_ROWS, _RATE = 2500, 25.0
# With targets on more joints than this, tours of all joints are candidates.
_MAX_JOINTS_WITHOUT_TOURS = 3
# Nominal duration of a part: a share of the whole duration, within limits in s.
_NOMINAL_SHARE, _MIN_NOMINAL, _MAX_NOMINAL = 0.25, 3.0, 8.0
# Parts from which the probe motion of a target is built.
_PROBE_PARTS = 6
# Family of effects that need the ends of a joint's travel to be distinguished from gravity.
_ELASTIC = 'elastic'
# Smallest chance of a certain size that is not stated as 0.
_MIN_CHANCE = 0.05
# Quantile of a joint's speed that counts as its top speed; smallest speed limit, rad/s.
_TOP_QUANTILE, _MIN_SPEED = 0.98, 0.03


def plan(samples: JointSamples, model: GravityModel, targets: Sequence[Target] | None = None,
         options: PlanOptions = PlanOptions(), diagnosis: Diagnosis | None = None,
         progress: Progress | None = None, obstacles: Obstacles | None = None) -> Plan:
    """
    Return the motion of largest utility for the targets, within the limits.

    :param samples: all samples of earlier recordings, fast ones included.
    :param model: gravity with an energy (chain or potential).
    :param targets: effects to resolve; None for the open findings of the diagnosis.
    :param diagnosis: of the same samples; computed if it is needed and not given.
    :param obstacles: collision check of poses.
    :raises OptionError: if nothing is open, a target is unknown, or no admissible motion excites
        any target.
    """
    report = progress or (lambda stage, share: None)
    task = _design_task(samples, model, targets, options, diagnosis, report, obstacles)
    report('plan', 0.5)
    chosen = task.selector.select()
    if not chosen:
        raise OptionError(f'plan: within these limits no motion of {options.duration:g} s adds '
                          f'enough information to the recordings: raise the duration, the speed '
                          f'or the reach, or widen the position limits')
    motion, times = task.selector.assemble(chosen)
    t, (q, qd, qdd) = sampled(motion, options.rate)
    report('plan', 1.0)
    expected = task.expectations(motion)
    notes = (*task.notes, *(_unlikely(each) for each in expected if not each.is_likely))
    return Plan(Trajectory(model.joints, t, q, qd, qdd), task.planned_parts(times, chosen),
                expected, notes, task.gravity_expectations(motion))


@dataclass(frozen=True, eq=False)
class _DesignTask:
    """Targets with their design problems, and the selector of a motion for them."""

    targets: tuple[Target, ...]
    problems: tuple[DesignProblem, ...]
    context: DesignContext
    diagnosis: Diagnosis | None
    selector: Selector
    notes: tuple[str, ...]
    uncertainty: GravityUncertainty | None

    def expectations(self, motion: Sequence[Segment]) -> tuple[Expectation, ...]:
        """Return the expected result of each effect."""
        both = self.context.joined(motion)
        duration = sum(segment.duration for segment in motion)
        expected = []
        for target, problem, before, after, reason in zip(
                self.targets, self.problems, self.selector.scores_before(),
                self.selector.scores_after(motion), self.selector.untestable(both)):
            assert isinstance(before, EffectScore) and isinstance(after, EffectScore)
            untested = problem.untested_alternatives(both, target.alternatives)
            untestable = (reason or problem.remaining_ambiguity(both, target.alternatives)
                          or _absorbed(after))
            expected.append(self._expectation(target, problem, before.without(untested),
                                              after.without(untested), untestable, duration))
        return tuple(expected)

    def _expectation(self, target: Target, problem: DesignProblem, before: EffectScore,
                     after: EffectScore, untestable: str, duration: float) -> Expectation:
        symbols = problem.target.effect.coefficients_of(
            self.context.recorded, problem.target.joint or 0, problem.target.setting)
        widths = {c.symbol: (1.96 * float(s), c.unit) for c, s in zip(symbols, after.std)}
        closest = '' if after.closest is None else problem.alternatives[after.closest].effect.name
        assumed = {c.symbol: float(v) for c, v in zip(symbols, problem.size)}
        separation_before = before.separation
        if self.diagnosis is not None:
            # The actual result of the diagnosis takes precedence over the expected one.
            separation_before = min(separation_before,
                                    observed_separation(target, self.diagnosis))
        added = max(after.separation ** 2 - before.separation ** 2, 0.0)
        separation = float(np.sqrt(separation_before ** 2 + added))
        required = [self.context.required_separation(problem, t) for t in (0.0, duration)]
        chance_before = power(separation_before, required[0]) * before.chance_of_certain_size
        chance = power(separation, required[1]) * after.chance_of_certain_size
        return Expectation(target, chance_before, 0.0 if untestable else chance, widths, closest,
                           assumed, problem.known_size, separation_before, separation, untestable,
                           required[1], after.unabsorbed)

    def gravity_expectations(self, motion: Sequence[Segment]) -> tuple[GravityExpectation, ...]:
        """Return the standard deviations of the uncertain joints before and after the motion."""
        if self.uncertainty is None:
            return ()
        after = self.selector.scores_after(motion)[-1]
        assert isinstance(after, GravityScore)
        names = self.context.model.joints
        return tuple(GravityExpectation(names[n], float(old), float(new)) for n, old, new in zip(
            self.uncertainty.joints, after.before, after.std))

    def planned_parts(self, times: Sequence[tuple[float, float]],
                      chosen: Sequence[Part]) -> tuple[PlannedPart, ...]:
        """Return descriptions of the parts; equal consecutive parts are one."""
        names = [target.name for target in self.targets] + [GRAVITY]
        joints = self.context.model.joints
        parts: list[PlannedPart] = []
        for (start, end), part in zip(times, chosen):
            one = PlannedPart(start, end, tuple(joints[n] for n in part.joints), part.what,
                              tuple(names[k] for k in self.selector.informs(part)))
            if parts and replace(one, start=0.0, end=0.0) == replace(parts[-1], start=0.0,
                                                                     end=0.0):
                one = replace(one, start=parts.pop().start)
            parts.append(one)
        return tuple(parts)


def _design_task(samples: JointSamples, model: GravityModel, targets: Sequence[Target] | None,
                 options: PlanOptions, diagnosis: Diagnosis | None, report: Progress,
                 obstacles: Obstacles | None) -> _DesignTask:
    samples = samples.joints(model.joints)
    if targets is None and diagnosis is None:
        report('diagnose', 0.0)
        diagnosis = diagnose(samples, model)
    space = workspace(samples, options, obstacles)
    context = _context(samples, model)
    gravity_named = targets is not None and any(t.effect == GRAVITY for t in targets)
    uncertainty = None
    if targets is None or gravity_named:
        uncertainty = gravity_uncertainty(model, samples.q, samples.tau, white_noise(samples),
                                          gravity_named)
    if targets is None and diagnosis is not None:
        targets = open_targets(diagnosis, context.recorded, options.goes_beyond)
        if uncertainty is not None:
            targets = targets[:MAX_TARGETS - 1]
    targets = [target for target in targets or () if target.effect != GRAVITY]
    if gravity_named and uncertainty is None:
        raise OptionError('plan: this model has no uncertainty of its gravity; fit it again')
    if not targets and uncertainty is None:
        raise OptionError('plan: no target is open; name the effects to resolve')
    targets = [with_ambiguous_findings(target, diagnosis) for target in targets]
    limits = _limits(options, targets, samples)
    report('plan', 0.2)
    parts = _candidates(space, model, targets, uncertainty, limits, options)
    if not parts:
        raise OptionError('plan: within the limits no joint of the targets can move; the '
                          'recorded range may be too narrow')
    problems, solvable, notes = _design_problems(targets, parts, context, diagnosis)
    auxiliary, _, _ = _design_problems(auxiliary_targets(solvable), parts, context, None)
    context = context.with_measured_noise([*problems, *auxiliary])
    main: list[Objective] = [EffectObjective(problem, context) for problem in problems]
    if uncertainty is not None:
        main.append(GravityObjective(uncertainty, context))
    selector = Selector(space, context, (main, [EffectObjective(problem, context, True)
                                                for problem in auxiliary]),
                        parts, limits, options.duration)
    return _DesignTask(tuple(solvable), tuple(problems), context, diagnosis, selector,
                       tuple(notes), uncertainty)


def _limits(options: PlanOptions, targets: Sequence[Target], samples: JointSamples) -> Limits:
    """
    Return the limits of speed, acceleration and jerk.

    An effect that changes with time is identified at the speeds of the earlier motion only. At
    other speeds its change mixes with that of friction by speed, and may cancel it.
    """
    limits = Limits(options.max_speed, options.max_acceleration, options.max_jerk)
    changing = [list(samples.names).index(target.joint) for target in targets
                if target.joint in samples.names
                and 's' in known_effect(target.effect).setting_units.values()]
    if not changing:
        return limits
    top = np.quantile(np.abs(samples.qd[:, changing]), _TOP_QUANTILE, axis=0).max()
    return limits.slower(max(float(top), _MIN_SPEED))


def _context(samples: JointSamples, model: GravityModel) -> DesignContext:
    """Return the context with white noise; `with_measured_noise` replaces that by the residual."""
    few = samples.select(evenly_picked(samples.n_samples, _ROWS))
    between = np.diff(samples.t)[np.diff(samples.runs) == 0]
    step = float(np.median(between)) if len(between) else 1.0
    rate = 1.0 / (np.maximum(white_noise(samples), 1e-6) ** 2 * step)
    return DesignContext(build_motion(few, model), model, rate, np.full(len(rate), 1.0 / step),
                         step, _RATE)


def _candidates(space: Workspace, model: GravityModel, targets: Sequence[Target],
                uncertainty: GravityUncertainty | None, limits: Limits,
                options: PlanOptions) -> list[Part]:
    names = list(model.joints)
    for target in targets:
        if target.joint is not None and target.joint not in names:
            raise OptionError(f'{target.name}: no joint {target.joint}; the joints are '
                              f'{", ".join(names)}')
    elsewhere = [other.partition(':')[2] for target in targets for other in target.alternatives]
    joints = [names.index(joint) for joint in (*(target.joint for target in targets), *elsewhere)
              if joint in names]
    if uncertainty is not None:
        joints += uncertainty.joints
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


def _design_problems(targets: Sequence[Target], parts: Sequence[Part], context: DesignContext,
                     diagnosis: Diagnosis | None
                     ) -> tuple[list[DesignProblem], list[Target], list[str]]:
    """Return the design problems, their targets, and why other targets have none."""
    noise = np.sqrt(1.0 / (context.information_rate * context.step))
    names = list(context.model.joints)
    problems, solvable, notes = [], [], []
    for target in targets:
        joint = names.index(target.joint) if target.joint in names else 0
        moving = [part for part in parts if joint in part.joints] or list(parts)
        probe = context.planned([s for part in moving[:_PROBE_PARTS] for s in part.segments], True)
        try:
            problems.append(design_problem(target, context.recorded, probe, noise, diagnosis))
        except OptionError as problem:
            notes.append(str(problem))
        else:
            solvable.append(target)
    if targets and not problems:
        raise OptionError('plan: ' + '; '.join(notes))
    return problems, solvable, notes


def _absorbed(after: EffectScore) -> str:
    """Return why a diagnosis will report the size as uncertain, '' if it may not."""
    if after.chance_of_certain_size >= _MIN_CHANCE:
        return ''
    return f'gravity may absorb all but {after.unabsorbed:.1%} of its torque'


def _unlikely(expected: Expectation) -> str:
    if expected.untestable:
        return (f'{expected.target.name}: no part within these limits resolves it: '
                f'{expected.untestable}')
    against = (f' against {expected.closest_alternative}' if expected.closest_alternative else '')
    return (f'{expected.target.name}: the chance that this motion resolves it{against} is only '
            f'{100 * expected.chance:.0f} %; a longer or faster motion or more reach may resolve '
            f'it')
