"""Shares of the effort that depend on pose and direction of motion: sign, and missing gravity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gravity_comp_ros.data.samples import evenly_picked, FloatArray
from gravity_comp_ros.facts.fact import Action, Fact, Kind, TIMES_GIVEN
from gravity_comp_ros.facts.options import FACTS
from gravity_comp_ros.facts.signals import Signals
import numpy as np


@dataclass(frozen=True)
class Shares:
    """
    Shares of the variance of a joint's effort.

    - `pose`: explained by a first-order fit on all joint angles.
    - `direction`: share of the rest that the direction of motion explains, with the sign of its
      coefficient, which is positive for friction.
    - `gravity`: as `pose`, of the effort that a fit of friction leaves; 0 if that is little.

    None where the motion does not show it.
    """

    pose: float | None = None
    direction: float | None = None
    gravity: float | None = None


def shares(q: FloatArray, qd: FloatArray, tau: FloatArray, n: int,
           moves: int | None = None) -> Shares:
    """
    Return the shares of joint n from q, qd and tau (M, N).

    :param moves: the joint whose direction of motion counts; None for n.
    """
    part, moves = evenly_picked(len(q), FACTS.max_samples), n if moves is None else moves
    q, speed, effort = q[part], qd[part, moves], tau[part, n]
    moving = np.ptp(q, axis=0) > FACTS.min_travel
    poses = np.column_stack([np.ones(len(q)), np.sin(q[:, moving]), np.cos(q[:, moving])])
    if not moving.any() or effort.std() < 1e-9 or len(q) < 4 * poses.shape[1]:
        return Shares()
    rest = without(poses, effort)
    pose = float(1 - rest.var() / effort.var())
    fastest = float(np.abs(speed).max())
    if fastest == 0 or not moving[moves] or rest.std() < 1e-9 * effort.std():
        return Shares(pose, None, pose)
    friction = np.column_stack([np.ones(len(q)), friction_columns(speed)])
    no_friction = without(friction, effort)
    both = without(np.column_stack([poses, friction[:, 1:]]), effort)
    gravity = float(1 - both.var() / max(float(no_friction.var()), 1e-18))
    if gravity * no_friction.var() < (FACTS.min_part * effort.std()) ** 2:
        gravity = 0.0
    direction = without(poses, friction[:, 1])
    if direction.std() < 1e-6:
        return Shares(pose, None, gravity)
    slope = float(direction @ rest / (direction @ direction))
    if abs(slope) < FACTS.min_part * effort.std():
        return Shares(pose, 0.0, gravity)
    share = slope ** 2 * float(direction.var() / rest.var())
    return Shares(pose, float(np.copysign(share, slope)), gravity)


def friction_columns(qd: FloatArray) -> FloatArray:
    """
    Return columns (M, 3, ...) of the friction of speeds qd (M, ...): two directions, and speed.

    The direction is that of the noise at rest, or changes smoothly over low speeds.
    """
    slow = FACTS.slow_speed * np.abs(qd).max(axis=0)
    return np.stack([np.tanh(qd / np.maximum(slow, 1e-12)), np.sign(qd), qd], axis=1)


def effort_facts(signals: Signals) -> list[Fact]:
    """Return the facts on the sign of the effort and on missing gravity."""
    if len(signals) < FACTS.min_samples:
        return []
    by_joint = {name: shares(signals.q, signals.qd, signals.tau, n)
                for n, name in enumerate(signals.names)}
    facts = (_exchanged(signals, by_joint), _sign(by_joint), _compensated(signals, by_joint))
    return [fact for fact in facts if fact is not None]


def _exchanged(signals: Signals, by_joint: Mapping[str, Shares]) -> Fact | None:
    """Return the fact that efforts have the friction of other joints, in a cycle."""
    names = list(by_joint)
    foreign = [n for n, each in enumerate(by_joint.values()) if each.direction is not None
               and abs(each.direction) < FACTS.min_share]
    of, share = {}, {}
    for n in foreign if len(foreign) > 1 else []:
        by = {m: shares(signals.q, signals.qd, signals.tau, n, m).direction or 0.0
              for m in foreign if m != n}
        best = max(by, key=by.__getitem__)
        if by[best] > FACTS.min_share:
            of[n], share[n] = best, by[best]
    cycle = {n: m for n, m in of.items() if m in of}
    if (not cycle or set(cycle) != set(cycle.values())
            or max(share[n] for n in cycle) < FACTS.min_single_share):
        return None
    parts = ', '.join(f'that of {names[n]} follows the direction of {names[m]}'
                      for n, m in cycle.items())
    return Fact(
        Kind.ORDER, tuple(names[n] for n in cycle), f'efforts have the friction of other joints: '
        f'{parts}', Action.REFUSED, 'efforts are exchanged between joints; correct their order '
        'in the driver', f'--accept {Kind.ORDER} if it is right')


def _sign(by_joint: Mapping[str, Shares]) -> Fact | None:
    known = {name: each.direction for name, each in by_joint.items() if each.direction is not None}
    against = [name for name, share in known.items() if share < -FACTS.min_share]
    # Without a joint of the right sign several show another convention of the driver; else each
    # is wired on its own.
    several = len(against) > 1 and max(known.values()) < FACTS.min_share
    if not several:
        against = [name for name, share in known.items() if share < -FACTS.min_single_share]
    if not against:
        return None
    inverted = tuple(by_joint if several else against)
    scales = ','.join(f'{name}=-1' for name in inverted)
    return Fact(
        Kind.EFFORT_SIGN, inverted, f'effort points against the motion on '
        f'{", ".join(against)}, opposite to friction', Action.REFUSED,
        'its sign looks reversed; a model of it would push the arm down',
        f'--effort-scale {scales} {TIMES_GIVEN}, or --accept effort_sign if it is right',
        {name: known[name] for name in against})


def _compensated(signals: Signals, by_joint: Mapping[str, Shares]) -> Fact | None:
    wide = signals.named(np.ptp(signals.q, axis=0) > FACTS.wide_travel)
    values = {name: share for name in wide if (share := by_joint[name].gravity) is not None}
    if len(values) < FACTS.min_wide_joints or max(values.values()) >= FACTS.min_share:
        return None
    return Fact(
        Kind.COMPENSATED, tuple(values), f'effort hardly depends on the pose of {len(values)} '
        f'joints that move (at most {100 * max(values.values()):.0f} % of what friction '
        f'leaves)',
        Action.NOTED, 'the drive may compensate gravity already', values=values)


def without(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Return values (M, ...) without their least-squares fit by columns (M, C)."""
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])
