"""Targets of a plan, from a diagnosis or by name, and their design problems."""

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
from gravity_comp_ros.planning.context import DesignProblem, Hypothesis
from gravity_comp_ros.planning.options import GRAVITY, Target
from gravity_comp_ros.planning.outcome import finding_of, outcome, UNTESTABLE
import numpy as np
from scipy import special

OPEN = ('ambiguous', 'untestable', 'weak')
# Effects of most joints; targets by default where the recording cannot show them.
_COMMON = ('coulomb_friction', 'viscous_friction', 'load_dependent_friction')
# Auxiliary targets on the joint of a target.
_AUXILIARY = ('coulomb_friction', 'viscous_friction', 'torque_offset')
# Confounders that are alternatives by default; others only if a diagnosis names them.
_CONFOUNDERS = (*_COMMON, 'torque_offset', 'joint_spring')
# Smallest travel of a joint that moves, rad; smallest load, as a share of the torque range, of a
# joint that carries gravity.
_MIN_TRAVEL, _MIN_LOAD = 0.02, 0.3
MAX_TARGETS = 10
_MAX_ALTERNATIVES, _MAX_SETTINGS = 8, 4
# Assumed size of an effect without estimate: a share of the joint's torque range, and at least
# this multiple of the noise.
_ASSUMED_OF_RANGE, _ASSUMED_OF_NOISE = 0.03, 0.5
# Largest separation of a weak finding, in standard errors.
_MAX_WEAK = 3.0


def named_targets(effects: Iterable[str], joints: tuple[str, ...]) -> list[Target]:
    """
    Return the targets `NAME` (every joint), `NAME:JOINT` and `gravity`.

    :raises OptionError: if an effect or joint is unknown, or named twice.
    """
    names = list(effects)
    targets = [Target(request.effect.name, request.joint) for request in requests(
        [name for name in names if name != GRAVITY], joints)]
    return [*targets, Target(GRAVITY, None)] if GRAVITY in names else targets


def open_targets(diagnosis: Diagnosis, motion: Motion, beyond: bool = False) -> list[Target]:
    """
    Return the open findings of a diagnosis, largest torque first.

    These are ambiguous, untestable and weak findings, the untestable alternatives of a finding,
    and untestable friction of a joint that moves. Inertia and Coriolis torque, which every arm
    has, are targets only by name.

    :param beyond: whether the motion may leave the recorded range. Gravity no longer absorbs an
        offset there, so that untestable offsets are targets as well.
    """
    common = (*_COMMON, *(('torque_offset',) if beyond else ()))
    ranked: dict[tuple[str, str | None], tuple[float, Target]] = {}
    names = motion.samples.names
    ranges = dict(zip(names, np.ptp(motion.samples.tau, axis=0)))
    for finding in diagnosis.findings:
        effect = all_effects().get(finding.effect or '')
        if (finding.verdict in OPEN and effect is not None
                and effect.expectation != Expectation.MOTION):
            torque = (finding.nrmse_before - finding.nrmse_after) * float(
                max(ranges.values()) if finding.joint is None else ranges[finding.joint])
            # Findings come before untestable friction.
            rank = 1e3 + torque
            ranked[effect.name, finding.joint] = (
                rank, Target(effect.name, finding.joint, finding.rivals))
            # The finding remains ambiguous until its alternatives are testable.
            for other in _untestable_alternatives(finding, diagnosis):
                ranked.setdefault((other, finding.joint), (
                    rank, Target(other, finding.joint, (effect.name,))))
    for joint, report in diagnosis.joints.items():
        number = names.index(joint)
        moves = np.ptp(motion.samples.q[:, number]) > _MIN_TRAVEL
        load = float(np.abs(motion.gravity[:, number]).max())
        for name in common:
            loaded = name != 'load_dependent_friction' or load > _MIN_LOAD * ranges[joint]
            if name in report.untestable and moves and loaded:
                ranked.setdefault((name, joint), (float(ranges[joint]), Target(name, joint)))
    ordered = sorted(ranked.values(), key=lambda pair: -pair[0])
    return [target for _, target in ordered[:MAX_TARGETS]]


def _untestable_alternatives(finding: Finding, diagnosis: Diagnosis) -> list[str]:
    """Return the alternatives on the joint of a finding that the recording cannot show."""
    if finding.joint is None:
        return []
    untestable = diagnosis.joints[finding.joint].untestable
    return [name for name in finding.rivals if name in untestable and name in all_effects()]


def with_ambiguous_findings(target: Target, diagnosis: Diagnosis | None) -> Target:
    """Return a target with the findings that name it as their alternative as alternatives."""
    elsewhere = [f'{f.effect}:{f.joint}' if f.joint else str(f.effect)
                 for f in (diagnosis.findings if diagnosis else ())
                 if f.effect and target.name in f.rivals]
    return replace(target, alternatives=tuple(dict.fromkeys([*target.alternatives, *elsewhere])))


def auxiliary_targets(targets: Sequence[Target]) -> list[Target]:
    """
    Return common effects on the joints of the targets, to be identified by the same motion.

    Without them the residual of the motion has many explanations, and a diagnosis tests
    corrections of friction only where friction is found.
    """
    named = {(target.effect, target.joint) for target in targets}
    return [Target(effect, joint) for joint in dict.fromkeys(t.joint for t in targets)
            if joint is not None for effect in _AUXILIARY if (effect, joint) not in named]


def observed_separation(target: Target, diagnosis: Diagnosis) -> float:
    """
    Return the separation that the recordings gave a target, in standard errors.

    It is 1 for an ambiguous finding, follows from the p-value of a weak one, and is 0 for an
    untestable effect.

    :return: infinity for a target that the diagnosis does not leave open.
    """
    finding = finding_of(target, diagnosis)
    if finding is None:
        return 0.0 if outcome(target, diagnosis) == UNTESTABLE else np.inf
    if finding.verdict not in OPEN:
        return np.inf
    if finding.verdict != Verdict.WEAK:
        return 1.0
    return float(np.clip(special.ndtri(1.0 - min(finding.p, 1.0)), 0.0, _MAX_WEAK))


def design_problem(target: Target, motion: Motion, probe: Motion, noise: FloatArray,
                   diagnosis: Diagnosis | None) -> DesignProblem:
    """
    Return the design problem of a target.

    :param probe: a motion that excites the effect, for its nonlinear parameters where the
        recording does not.
    :param noise: standard deviation (N,) of the residual, N·m.
    :raises OptionError: if the effect or joint is unknown, or no motion excites it.
    """
    effect = known_effect(target.effect)
    joint = _joint(effect, target.joint, motion.samples.names)
    finding = finding_of(target, diagnosis)
    settings = [dict(finding.setting)] if finding and finding.setting else _settings(
        effect, motion, probe, joint)
    if not settings:
        raise OptionError(f'{target.name}: no motion within the limits excites it')
    hypothesis = Hypothesis(effect, joint, settings[0])
    others = _alternatives(target, effect, motion, probe)
    arm = effect.scope == 'arm' or any(other.effect.scope == 'arm' for other in others)
    joints = tuple(range(motion.samples.n_joints)) if arm else (joint or 0,)
    estimate = _estimated_size(finding, hypothesis, motion)
    size = _assumed_size(hypothesis, motion, probe, noise) if estimate is None else estimate
    return DesignProblem(hypothesis, others, size, joints, estimate is not None)


def _alternatives(target: Target, effect: Effect, motion: Motion,
                  probe: Motion) -> tuple[Hypothesis, ...]:
    hypotheses: list[Hypothesis] = []
    for text in dict.fromkeys([*target.alternatives, *effect.confounders]):
        name, _, where = text.partition(':')
        other = all_effects().get(name)
        counts = name in _CONFOUNDERS or text in target.alternatives
        if other is None or name == effect.name or not counts:
            continue
        try:
            place = _joint(other, where or target.joint, motion.samples.names)
            settings = _settings(other, motion, probe, place)
        except GravityCompError:
            continue
        hypotheses += [Hypothesis(other, place, setting) for setting in settings[:_MAX_SETTINGS]]
    return tuple(hypotheses[:_MAX_ALTERNATIVES * _MAX_SETTINGS])


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
    """Return some values of an effect's nonlinear parameters, spread over its grid."""
    for where in (motion, probe):
        try:
            grid: list[dict[str, float]] = effect.settings(where, joint or 0)
            for setting in grid[:1]:
                effect.columns(probe, joint or 0, setting)
        except (KeyError, ValueError, IndexError):
            continue
        if grid:
            picked = np.unique(np.linspace(0, len(grid) - 1, _MAX_SETTINGS).round().astype(int))
            return [grid[k] for k in picked]
    return []


def _estimated_size(finding: Finding | None, one: Hypothesis, motion: Motion) -> FloatArray | None:
    """
    Return the coefficients of a finding, None without usable ones.

    Those of a payload depend on the gravity model, and that of a diagnosis may be another.
    """
    symbols = tuple(each.symbol for each in one.effect.coefficients_of(
        motion, one.joint or 0, one.setting))
    if finding is None or tuple(finding.coefficients) != symbols:
        return None
    values = np.array([estimate.value for estimate in finding.coefficients.values()])
    return values if np.isfinite(values).all() and values.any() else None


def _assumed_size(one: Hypothesis, motion: Motion, probe: Motion,
                  noise: FloatArray) -> FloatArray:
    """
    Return coefficients whose peak torque is relevant.

    By the mean square, friction that fades, or that acts near reversals only, would be assumed
    far too large.
    """
    torque = np.maximum(_ASSUMED_OF_RANGE * np.ptp(motion.samples.tau, axis=0),
                        _ASSUMED_OF_NOISE * noise)
    shares = [np.abs(one.effect.columns_of_arm(where, one.joint or 0, one.setting)).max(axis=0)
              / torque[:, None] for where in (motion, probe)]
    peak = np.maximum(*(share.max(axis=0) for share in shares))
    return np.asarray(1.0 / np.maximum(peak, 1e-9) / np.sqrt(len(peak)))
