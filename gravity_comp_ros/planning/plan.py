"""Plan the recording that settles what earlier ones leave open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import evenly_picked, JointSamples
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.diagnosis.options import MIN_UNABSORBED
from gravity_comp_ros.effects.motion import build_motion
from gravity_comp_ros.effects.request import known_effect
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.nuisance_columns import white_noise
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.candidates import candidates, of_all_joints, Part
from gravity_comp_ros.planning.choice import Chooser
from gravity_comp_ros.planning.criterion import Answer, chance
from gravity_comp_ros.planning.expected import (
    Expectation, GravityExpectation, Plan, PlannedPart)
from gravity_comp_ros.planning.gravity_doubt import gravity_doubt, GravityAnswer, GravityDoubt
from gravity_comp_ros.planning.inquiry import EffectInquiry, GravityInquiry, Inquiry
from gravity_comp_ros.planning.options import GRAVITY, PlanOptions, Target
from gravity_comp_ros.planning.questions import (
    companions, MOST_TARGETS, observed_separation, open_targets, question, with_stand_ins)
from gravity_comp_ros.planning.regressors import NoiseRate, Question, Situation
from gravity_comp_ros.planning.segments import Pace, sampled, Segment
from gravity_comp_ros.planning.workspace import Obstacles, Workspace, workspace
import numpy as np

Progress = Callable[[str, float], None]

# Rows of the recordings that are looked at, rate in Hz at which candidates are judged.
_ROWS, _RATE = 2500, 25.0
# Where targets are on more joints than this, parts that move all joints are tried too.
_TOGETHER = 3
# The family of effects that are told from gravity at the ends of a joint's travel.
_ELASTIC = 'elastic'
# The share of the samples that are slower than a joint's top speed; no motion is slower, rad/s.
_TOP, _SLOWEST = 0.98, 0.03


def plan(samples: JointSamples, model: GravityModel, targets: Sequence[Target] | None = None,
         options: PlanOptions = PlanOptions(), diagnosis: Diagnosis | None = None,
         progress: Progress | None = None, obstacles: Obstacles | None = None) -> Plan:
    """
    Return the motion that settles most within the limits.

    :param samples: all samples of earlier recordings, fast ones too.
    :param model: gravity with an energy (chain or potential).
    :param targets: what to settle; None for what the diagnosis leaves open.
    :param diagnosis: of the same samples; made if it is needed and not given.
    :param obstacles: what the arm must not hit, itself for one.
    :raises OptionError: if nothing is left open, a target is unknown, or no admissible motion
        shows any of them.
    """
    tell = progress or (lambda words, share: None)
    asked = _asked(samples, model, targets, options, diagnosis, tell, obstacles)
    tell('plan', 0.5)
    chosen = asked.chooser.choose()
    if not chosen:
        raise OptionError(f'plan: within these limits no motion of {options.duration:g} s adds '
                          f'much to the recordings: raise the duration, the speed or the reach, '
                          f'or widen the position limits')
    motion, stretches = asked.chooser.assemble(chosen)
    t, (q, qd, qdd) = sampled(motion, options.rate)
    tell('plan', 1.0)
    expected = asked.expectations(motion)
    notes = (*asked.notes, *(_unlikely(each) for each in expected if not each.is_likely))
    return Plan(Trajectory(model.joints, t, q, qd, qdd),
                _planned_parts(stretches, chosen, asked, model.joints), expected, notes,
                asked.gravity(motion))


@dataclass(frozen=True, eq=False)
class _Asked:
    """The targets that can be planned for, and the one who chooses among parts."""

    named: tuple[Target, ...]
    questions: tuple[Question, ...]
    situation: Situation
    diagnosis: Diagnosis | None
    chooser: Chooser
    notes: tuple[str, ...]
    doubt: GravityDoubt | None

    def expectations(self, motion: Sequence[Segment]) -> tuple[Expectation, ...]:
        before, after = self.chooser.answers_before(), self.chooser.answers_after(motion)
        both = self.chooser.joined(motion)
        each = zip(self.named, self.questions, before, after, self.chooser.untestable(both))
        found = []
        for target, asked, old, new, reason in each:
            assert isinstance(old, Answer) and isinstance(new, Answer)
            none = asked.never_tested(both, target.alternatives)
            found.append(_expectation(target, asked, old.without(none), new.without(none),
                                      self.situation, self.diagnosis,
                                      reason or asked.tie_stays(both, target.alternatives)
                                      or _imitated(new)))
        return tuple(found)

    def gravity(self, motion: Sequence[Segment]) -> tuple[GravityExpectation, ...]:
        """Return what becomes of the doubt about gravity, joint by joint."""
        if self.doubt is None:
            return ()
        after = self.chooser.answers_after(motion)[-1]
        assert isinstance(after, GravityAnswer)
        names = self.situation.model.joints
        return tuple(GravityExpectation(names[n], float(old), float(new)) for n, old, new in zip(
            self.doubt.joints, after.before, after.std))

    def names(self) -> list[str]:
        return [target.name for target in self.named] + [GRAVITY] * (self.doubt is not None)


def _asked(samples: JointSamples, model: GravityModel, targets: Sequence[Target] | None,
           options: PlanOptions, diagnosis: Diagnosis | None, tell: Progress,
           obstacles: Obstacles | None = None) -> _Asked:
    samples = samples.joints(model.joints)
    if targets is None and diagnosis is None:
        tell('diagnose', 0.0)
        diagnosis = diagnose(samples, model)
    space = workspace(samples, options, obstacles)
    situation = _situation(samples, model)
    asked_for = targets is not None and any(t.effect == GRAVITY for t in targets)
    doubt = None
    if targets is None or asked_for:
        doubt = gravity_doubt(model, samples.q, samples.tau, white_noise(samples), asked_for)
    if targets is None and diagnosis is not None:
        targets = open_targets(diagnosis, situation.recorded, options.goes_beyond)
        if doubt is not None and len(targets) == MOST_TARGETS:
            targets = [t for k, t in enumerate(targets) if k < MOST_TARGETS - 1]
    targets = [target for target in targets or () if target.effect != GRAVITY]
    if asked_for and doubt is None:
        raise OptionError('plan: this model holds no uncertainty of its gravity; fit it again')
    if not targets and doubt is None:
        raise OptionError('plan: nothing is left open; name what to settle')
    targets = [with_stand_ins(target, diagnosis) for target in targets]
    pace = _pace(options, targets, samples)
    tell('plan', 0.2)
    parts = _parts(space, model, targets, doubt, pace, options)
    if not parts:
        raise OptionError('plan: within the limits no joint of the targets can move; the '
                          'recorded range may be too narrow')
    questions, named, notes = _questions(targets, parts, situation, diagnosis)
    beside, _, _ = _questions(companions(named), parts, situation, None)
    situation = situation.measured([*questions, *beside])
    main: list[Inquiry] = [EffectInquiry(each, situation) for each in questions]
    if doubt is not None:
        main.append(GravityInquiry(doubt, situation))
    chooser = Chooser(space, situation, (main, [EffectInquiry(each, situation, True)
                                                for each in beside]),
                      parts, pace, options.duration)
    return _Asked(tuple(named), tuple(questions), situation, diagnosis, chooser, tuple(notes),
                  doubt)


def _pace(options: PlanOptions, targets: Sequence[Target], samples: JointSamples) -> Pace:
    """
    Return the limits of speed, acceleration and jerk.

    What changes with time shows where a motion is like the earlier one. At other speeds the
    change mixes with that of friction by speed, and may even cancel it.
    """
    pace = Pace(options.max_speed, options.max_acceleration, options.max_jerk)
    changing = [list(samples.names).index(target.joint) for target in targets
                if target.joint in samples.names
                and 's' in known_effect(target.effect).setting_units.values()]
    if not changing:
        return pace
    top = np.quantile(np.abs(samples.qd[:, changing]), _TOP, axis=0).max()
    return pace.slower(max(float(top), _SLOWEST))


def _situation(samples: JointSamples, model: GravityModel) -> Situation:
    few = samples.select(evenly_picked(samples.n_samples, _ROWS))
    between = np.diff(samples.t)[np.diff(samples.runs) == 0]
    step = float(np.median(between)) if len(between) else 1.0
    # The noise is measured once it is known what is looked for.
    noise = NoiseRate(1.0 / (np.maximum(white_noise(samples), 1e-6) ** 2 * step))
    return Situation(build_motion(few, model), model, noise, step, _RATE)


def _parts(space: Workspace, model: GravityModel, targets: Sequence[Target],
           doubt: GravityDoubt | None, pace: Pace, options: PlanOptions) -> list[Part]:
    names = list(model.joints)
    for target in targets:
        if target.joint is not None and target.joint not in names:
            raise OptionError(f'{target.name}: no joint {target.joint}; the joints are '
                              f'{", ".join(names)}')
    elsewhere = [other.partition(':')[2] for target in targets for other in target.alternatives]
    joints = [names.index(joint) for joint in (*(target.joint for target in targets), *elsewhere)
              if joint in names]
    if doubt is not None:
        joints += doubt.joints
    if any(target.joint is None for target in targets):
        joints += list(range(len(names)))
    longest = float(np.clip(0.25 * options.duration, 3.0, 8.0))
    found: list[Part] = []
    for joint in dict.fromkeys(joints):
        springs = any(known_effect(target.effect).family == _ELASTIC for target in targets
                      if target.joint in (None, names[joint]))
        found += candidates(space, model, joint, pace, longest, springs)
    if len(set(joints)) > _TOGETHER:
        found += of_all_joints(space, pace, options.duration)
    return found


def _questions(targets: Sequence[Target], parts: Sequence[Part], situation: Situation,
               diagnosis: Diagnosis | None
               ) -> tuple[list[Question], list[Target], list[str]]:
    noise = np.sqrt(1.0 / (situation.noise.per_second * situation.step))
    questions, named, notes = [], [], []
    for target in targets:
        joint = (list(situation.model.joints).index(target.joint)
                 if target.joint in situation.model.joints else 0)
        showing = [part for part in parts if joint in part.joints] or list(parts)
        probe = situation.planned([s for part in showing[:6] for s in part.segments], True)
        try:
            questions.append(question(target, situation.recorded, probe, noise, diagnosis))
        except OptionError as problem:
            notes.append(str(problem))
        else:
            named.append(target)
    if targets and not questions:
        raise OptionError('plan: ' + '; '.join(notes))
    return questions, named, notes


def _planned_parts(stretches: list[tuple[float, float]], chosen: Sequence[Part], asked: _Asked,
                   joints: tuple[str, ...]) -> tuple[PlannedPart, ...]:
    found: list[PlannedPart] = []
    for (start, end), part in zip(stretches, chosen):
        settles = tuple(asked.names()[k] for k in asked.chooser.helps(part))
        this = PlannedPart(start, end, tuple(joints[n] for n in part.joints), part.what, settles)
        if found and replace(this, start=0.0, end=0.0) == replace(found[-1], start=0.0, end=0.0):
            # The same again is one part.
            this = replace(this, start=found.pop().start)
        found.append(this)
    return tuple(found)


def _imitated(after: Answer) -> str:
    """Return why a diagnosis will call a size uncertain, '' if it will not."""
    if after.left >= MIN_UNABSORBED:
        return ''
    return f'gravity may imitate all but {after.left:.1%} of its torque'


def _unlikely(expected: Expectation) -> str:
    if expected.untestable:
        return (f'{expected.target.name}: no part within these limits settles it: '
                f'{expected.untestable}')
    beside = f' beside {expected.hardest}' if expected.hardest else ''
    return (f'{expected.target.name}: this motion settles it{beside} with a chance of '
            f'{100 * expected.chance:.0f} % only; a longer or faster motion, or more reach, may')


def _expectation(target: Target, asked: Question, before: Answer, after: Answer,
                 situation: Situation, diagnosis: Diagnosis | None,
                 untestable: str) -> Expectation:
    symbols = asked.target.effect.coefficients_of(
        situation.recorded, asked.target.joint or 0, asked.target.setting)
    widths = {c.symbol: (1.96 * float(s), c.unit) for c, s in zip(symbols, after.spread)}
    hardest = '' if after.worst is None else asked.alternatives[after.worst].effect.name
    assumed = {c.symbol: float(v) for c, v in zip(symbols, asked.size)}
    seen = before.separation
    if diagnosis is not None:
        # The recordings have left the question open, whatever they might have said.
        seen = min(seen, observed_separation(target, diagnosis))
    added = max(after.separation ** 2 - before.separation ** 2, 0.0)
    separation = float(np.sqrt(seen ** 2 + added))
    stated = 0.0 if untestable else chance(separation)
    return Expectation(target, chance(seen), stated, widths, hardest, assumed,
                       asked.known_size, seen, separation, untestable)
