"""Motion of a recording: range and speed of each joint, and terms that it cannot identify."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gravity_comp_ros.data.gate import FAST, GateOptions, slow_samples
from gravity_comp_ros.data.runs import reversals_of, run_slices
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.facts.friction import shares
from gravity_comp_ros.facts.options import FACTS
import numpy as np

# Columns of a table of joints; see `JointFacts.cells`.
MOTION = ('range rad', 'travel rad', 'rms rad/s', 'max rad/s', 'reversals', 'effort N·m')


@dataclass(frozen=True)
class JointFacts:
    """
    One joint of a recording.

    Angles in rad, speeds in rad/s, torques in N·m. `reversals` is the number of reversals of
    more than 0.01 rad, None for poses at rest. `pose_share` is the share of the torque's variance
    explained by a first-order fit on all joint angles, None without motion.
    """

    q_min: float
    q_max: float
    max_speed: float
    rms_speed: float
    reversals: int | None
    tau_min: float
    tau_max: float
    tau_std: float
    pose_share: float | None

    @property
    def travel(self) -> float:
        return self.q_max - self.q_min

    def cells(self) -> tuple[str, ...]:
        """Return the columns `MOTION` as text."""
        # Two digits at least of a torque of any size.
        digits = '.2f' if max(-self.tau_min, self.tau_max) >= 0.1 else '.2g'
        return (f'{self.q_min:.2f} … {self.q_max:.2f}', f'{self.travel:.2f}',
                f'{self.rms_speed:.3f}', f'{self.max_speed:.3f}',
                '–' if self.reversals is None else str(self.reversals),
                f'{self.tau_min:{digits}} … {self.tau_max:{digits}}')


@dataclass(frozen=True)
class RecordingFacts:
    """
    A recording: its joints, the result of the slow-motion gate, and facts about the motion.

    `slow_share` is the share of samples in which every joint is slow; `kept` the number of them
    after the gate has reduced the rate. `at_rest` is True if every velocity is 0, as in a series
    of poses. `motion` are facts on terms that are not identifiable, with reasons.
    """

    joints: dict[str, JointFacts]
    n_samples: int
    slow_share: float
    kept: int
    at_rest: bool
    motion: tuple[Fact, ...]

    @property
    def remarks(self) -> tuple[str, ...]:
        """Return the sentences of the facts about the motion."""
        return tuple(fact.sentence for fact in self.motion)

    def to_json(self) -> dict[str, Any]:
        """Return the facts as `info --json` prints them."""
        return {'joints': self.joints,
                'slow_share': self.slow_share, 'kept': self.kept, 'at_rest': self.at_rest,
                'remarks': self.remarks}


def describe(samples: JointSamples, options: GateOptions = GateOptions()) -> RecordingFacts:
    """Return the facts about a recording of one or several runs."""
    gate = slow_samples(samples, options)
    slow_share = 1 - gate.dropped.get(FAST, 0) / max(len(samples), 1)
    at_rest = not samples.qd.any()
    joints = {name: _joint(samples, n, at_rest) for n, name in enumerate(samples.names)}
    motion = (*_speed_facts(joints, slow_share, gate.kept, len(samples), options),
              *_travel_facts(joints, at_rest))
    return RecordingFacts(joints, len(samples), slow_share, gate.kept, at_rest, motion)


def _joint(samples: JointSamples, n: int, at_rest: bool) -> JointFacts:
    q, qd, tau = samples.q[:, n], samples.qd[:, n], samples.tau[:, n]
    reversals = None if at_rest else sum(
        max(0, len(reversals_of(q[run], FACTS.min_travel)) - 1) for run in run_slices(samples))
    return JointFacts(
        float(q.min()), float(q.max()), float(np.abs(qd).max()), float(np.sqrt(np.mean(qd ** 2))),
        reversals, float(tau.min()), float(tau.max()), float(tau.std()),
        shares(samples.q, samples.qd, samples.tau, n).pose)


def _speed_facts(joints: dict[str, JointFacts], slow_share: float, kept: int, total: int,
                 options: GateOptions) -> list[Fact]:
    if slow_share < FACTS.min_slow:
        fastest = max(joints, key=lambda name: joints[name].max_speed)
        return [_noted(
            (), f'too fast: every joint is under {options.limits} rad/s in only '
            f'{100 * slow_share:.1f} % of the samples ({kept} kept by the gate), {fastest} '
            f'reaches {joints[fastest].max_speed:.2f} rad/s; the torque is gravity, friction and '
            f'inertia together', '`fit` can use it, with friction and inertia as nuisance '
            'terms, but gravity is more accurate from slow motion')]
    if kept < FACTS.min_slow_samples:
        return [_noted((), f'short: the gate keeps {kept} of {total} samples',
                       'too few to evaluate a model')]
    return []


def _travel_facts(joints: dict[str, JointFacts], at_rest: bool) -> list[Fact]:
    result: list[Fact] = []
    low, wide = FACTS.min_travel, FACTS.wide_travel
    still = tuple(name for name, facts in joints.items() if facts.travel < low)
    narrow = {name: f'{name} ({facts.travel:.2g} rad)' for name, facts in joints.items()
              if low <= facts.travel < wide}
    if still:
        result.append(_noted(still, f'never moves: {", ".join(still)}',
                             'gravity at other angles of that joint is not identifiable'))
    if narrow:
        result.append(_noted(tuple(narrow), f'moves little: {", ".join(narrow.values())}',
                             'a model is valid only near these angles'))
    if at_rest:
        result.append(_noted((), 'poses at rest (every velocity is 0)', 'friction is not '
                             'identifiable, and static friction remains in the torque'))
        return result
    one_way = tuple(name for name, facts in joints.items()
                    if facts.travel >= low and facts.reversals == 0)
    if one_way:
        result.append(_noted(one_way, f'one direction only: {", ".join(one_way)}', 'friction '
                             'cannot be separated from gravity without motion in the other '
                             'direction'))
    return result


def _noted(names: tuple[str, ...], evidence: str, done: str = '') -> Fact:
    return Fact(Kind.MOTION, names, evidence, Action.NOTED, done)
