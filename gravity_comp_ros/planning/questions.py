"""From a diagnosis, or from names, to the questions that a motion is to settle."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding, Verdict
from gravity_comp_ros.effects.effect import Effect, Expectation, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.effects.request import known_effect, requests
from gravity_comp_ros.errors import GravityCompError, OptionError
from gravity_comp_ros.planning.options import GRAVITY, Target
from gravity_comp_ros.planning.outcome import finding_of, outcome, UNTESTABLE
from gravity_comp_ros.planning.regressors import Alternative, Question
import numpy as np
from scipy import special

OPEN = ('ambiguous', 'untestable', 'weak')
# Effects that most joints have: worth asking for where the recording cannot show them.
_COMMON = ('coulomb_friction', 'viscous_friction', 'load_dependent_friction')
_USUAL = ('coulomb_friction', 'viscous_friction', 'torque_offset')
# What else is expected in a joint. A rarer effect is an alternative only if a diagnosis names it.
_EXPECTED = (*_COMMON, 'torque_offset', 'joint_spring')
# A joint that travels further, rad, moves; one whose load is a larger share of its torque's range
# carries gravity.
_MOVES, _LOADED = 0.02, 0.3
MOST_TARGETS = 10
_MOST_ALTERNATIVES, _MOST_SETTINGS = 8, 4
# An effect of unknown size is taken to be this share of the joint's torque range, and no less
# than this many standard deviations of noise.
_WORTH, _ABOVE_NOISE = 0.03, 0.5
# Standard errors that a weak finding has at most: it was not settled.
_MOST_WEAK = 3.0


def named_targets(effects: Iterable[str], joints: tuple[str, ...]) -> list[Target]:
    """
    Return the targets of effects `NAME` (every joint) or `NAME:JOINT`; `gravity` is a target too.

    :raises OptionError: if an effect or joint is unknown, or asked for twice.
    """
    named = list(effects)
    found = [Target(request.effect.name, request.joint) for request in requests(
        [name for name in named if name != GRAVITY], joints)]
    return [*found, Target(GRAVITY, None)] if GRAVITY in named else found


def open_targets(diagnosis: Diagnosis, motion: Motion, beyond: bool = False) -> list[Target]:
    """
    Return what a diagnosis leaves open, that which costs most first.

    These are ambiguous, untestable and weak findings, the other side of a tie where the recording
    cannot show it, and friction that it cannot show on a joint that moves. Inertia and Coriolis
    torque, which every arm has, are left to those who ask for them by name.

    :param beyond: whether poses beyond the recorded ones may be visited. There gravity no longer
        imitates an offset, so that those count as well.
    """
    common = (*_COMMON, *(('torque_offset',) if beyond else ()))
    found: dict[tuple[str, str | None], tuple[float, Target]] = {}
    names = motion.samples.names
    spans = dict(zip(names, np.ptp(motion.samples.tau, axis=0)))
    for finding in diagnosis.findings:
        known = all_effects().get(finding.effect or '')
        if (finding.verdict in OPEN and known is not None
                and known.expectation != Expectation.MOTION):
            cost = (finding.nrmse_before - finding.nrmse_after) * float(
                max(spans.values()) if finding.joint is None else spans[finding.joint])
            target = Target(known.name, finding.joint, finding.rivals)
            found[target.effect, target.joint] = (1e3 + cost, target)
            # A tie stays one as long as the other effect cannot be tested.
            for rival in _untested(finding, diagnosis):
                found.setdefault((rival, finding.joint), (
                    1e3 + cost, Target(rival, finding.joint, (known.name,))))
    for joint, report in diagnosis.joints.items():
        number = names.index(joint)
        moves = np.ptp(motion.samples.q[:, number]) > _MOVES
        load = float(np.abs(motion.gravity[:, number]).max())
        for effect in common:
            loaded = effect != 'load_dependent_friction' or load > _LOADED * spans[joint]
            if effect in report.untestable and moves and loaded:
                target = Target(effect, joint)
                found.setdefault((effect, joint), (float(spans[joint]), target))
    ordered = sorted(found.values(), key=lambda pair: -pair[0])
    return [target for _, target in ordered[:MOST_TARGETS]]


def _untested(finding: Finding, diagnosis: Diagnosis) -> list[str]:
    """Return the rivals on the joint of a finding that the recording cannot show."""
    if finding.joint is None:
        return []
    untestable = diagnosis.joints[finding.joint].untestable
    return [rival for rival in finding.rivals if rival in untestable and rival in all_effects()]


def with_stand_ins(target: Target, diagnosis: Diagnosis | None) -> Target:
    """Return a target whose alternatives have what was found elsewhere and could be it as well."""
    elsewhere = [f'{f.effect}:{f.joint}' if f.joint else str(f.effect)
                 for f in (diagnosis.findings if diagnosis else ())
                 if f.effect and target.name in f.rivals]
    return replace(target, alternatives=tuple(dict.fromkeys([*target.alternatives, *elsewhere])))


def companions(targets: Sequence[Target]) -> list[Target]:
    """
    Return usual effects on the joints of the targets, which a diagnosis has to tell beside them.

    A motion that shows nothing but its target leaves the rest of the torque to many explanations,
    and an effect that corrects friction is looked for only where friction is found.
    """
    there = {(target.effect, target.joint) for target in targets}
    return [Target(effect, joint) for joint in dict.fromkeys(t.joint for t in targets)
            if joint is not None for effect in _USUAL if (effect, joint) not in there]


def observed_separation(target: Target, diagnosis: Diagnosis) -> float:
    """
    Return the standard errors by which recordings have shown a target.

    A tie is within one standard error; a weak finding has its p-value; of what could not be
    tested nothing was seen.

    :return: infinity for what the diagnosis does not leave open.
    """
    finding = finding_of(target, diagnosis)
    if finding is None:
        return 0.0 if outcome(target, diagnosis) == UNTESTABLE else np.inf
    if finding.verdict not in OPEN:
        return np.inf
    if finding.verdict != Verdict.WEAK:
        return 1.0
    return float(np.clip(special.ndtri(1.0 - min(finding.p, 1.0)), 0.0, _MOST_WEAK))


def question(target: Target, motion: Motion, probe: Motion, noise: FloatArray,
             diagnosis: Diagnosis | None) -> Question:
    """
    Return the question of a target.

    :param probe: a motion that shows the effect, for its settings where the recording has none.
    :param noise: standard deviation (N,) of the residual, N·m.
    :raises OptionError: if the effect or joint is unknown, or no motion can show it.
    """
    effect = known_effect(target.effect)
    joint = _joint(effect, target.joint, motion.samples.names)
    finding = finding_of(target, diagnosis)
    settings = [dict(finding.setting)] if finding and finding.setting else _settings(
        effect, motion, probe, joint)
    if not settings:
        raise OptionError(f'{target.name}: no motion within the limits shows it')
    mine = Alternative(effect, joint, settings[0])
    others = _alternatives(target, effect, joint, motion, probe)
    arm = effect.scope == 'arm' or any(other.effect.scope == 'arm' for other in others)
    joints = tuple(range(motion.samples.n_joints)) if arm else (joint or 0,)
    size = _known_size(finding, mine, motion)
    known = size is not None
    if size is None:
        size = _typical_size(mine, motion, probe, noise)
    return Question(mine, others, size, joints, known)


def _alternatives(target: Target, effect: Effect, joint: int | None, motion: Motion,
                  probe: Motion) -> tuple[Alternative, ...]:
    found: list[Alternative] = []
    known = all_effects()
    wanted = [*target.alternatives, *effect.confounders]
    for text in dict.fromkeys(wanted):
        name, _, where = text.partition(':')
        other = known.get(name)
        expected = name in _EXPECTED or text in target.alternatives
        if other is None or name == effect.name or not expected:
            continue
        try:
            place = _joint(other, where or target.joint, motion.samples.names)
            settings = _settings(other, motion, probe, place)
        except GravityCompError:
            continue
        found += [Alternative(other, place, setting) for setting in settings[:_MOST_SETTINGS]]
    return tuple(found[:_MOST_ALTERNATIVES * _MOST_SETTINGS])


def _joint(effect: Effect, name: str | None, names: Sequence[str]) -> int | None:
    if not effect.per_joint:
        return None
    if name is None:
        raise OptionError(f'{effect.name} is an effect of one joint: name it '
                          f'({effect.name}:JOINT)')
    if name not in names:
        raise OptionError(f'no joint {name}; the joints are {", ".join(names)}')
    return list(names).index(name)


def _settings(effect: Effect, motion: Motion, probe: Motion,
              joint: int | None) -> list[Setting]:
    """Return some settings of an effect, spread over those that it would try."""
    for where in (motion, probe):
        try:
            every: list[dict[str, float]] = effect.settings(where, joint or 0)
            for setting in every[:1]:
                effect.columns(probe, joint or 0, setting)
        except (KeyError, ValueError, IndexError):
            continue
        if every:
            picked = np.unique(np.linspace(0, len(every) - 1, _MOST_SETTINGS).round().astype(int))
            return [every[k] for k in picked]
    return []


def _known_size(finding: Finding | None, one: Alternative, motion: Motion) -> FloatArray | None:
    """
    Return the coefficients that a diagnosis found, None if it found none.

    Those of a payload follow the gravity model, and a diagnosis may have another than the plan.
    """
    symbols = tuple(each.symbol for each in one.effect.coefficients_of(
        motion, one.joint or 0, one.setting))
    if finding is None or tuple(finding.coefficients) != symbols:
        return None
    values = np.array([estimate.value for estimate in finding.coefficients.values()])
    return values if np.isfinite(values).all() and values.any() else None


def _typical_size(one: Alternative, motion: Motion, probe: Motion,
                  noise: FloatArray) -> FloatArray:
    """
    Return coefficients whose torque would be worth knowing at its largest.

    The largest counts: friction that fades, or that differs near reversals only, has a small
    mean square, and would be taken to be enormous.
    """
    torque = np.maximum(_WORTH * np.ptp(motion.samples.tau, axis=0), _ABOVE_NOISE * noise)
    joint = one.joint or 0
    per_torque = np.zeros(0)
    for where in (motion, probe):
        columns = one.effect.columns_of_arm(where, joint, one.setting)
        share = np.abs(columns).max(axis=0) / torque[:, None]
        per_torque = np.maximum(share.max(axis=0), per_torque) if len(per_torque) else \
            share.max(axis=0)
    return np.asarray(1.0 / np.maximum(per_torque, 1e-9) / np.sqrt(len(per_torque)))
