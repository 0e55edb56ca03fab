"""Joints that are not revolute joints of the arm: grippers, wheels, linear axes."""

from __future__ import annotations

from collections.abc import Sequence
import re

from gravity_comp_ros.data.samples import evenly_picked
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.facts.friction import friction_columns, without
from gravity_comp_ros.facts.options import FACTS
from gravity_comp_ros.facts.signals import Signals
import numpy as np

_WORD = re.compile(r'[A-Z]?[a-z]+|[A-Z]+')
_GRIPPERS = {'gripper', 'grippers', 'finger', 'fingers', 'jaw', 'jaws', 'claw', 'knuckle', 'thumb',
             'wheel', 'wheels', 'caster', 'suction', 'vacuum'}
_LINEAR = {'rail', 'slide', 'slider', 'linear', 'prismatic', 'gantry', 'elevator'}
_KEEP = '--joints keeps it if named there'


def named_facts(names: Sequence[str]) -> list[Fact]:
    """
    Return the facts on joints with names of grippers, wheels and linear axes.

    There are none if every joint has such a name.
    """
    words = {name: {word.lower() for word in _WORD.findall(name)} for name in names}
    grippers = tuple(name for name in names if words[name] & _GRIPPERS)
    linear = tuple(name for name in names if name not in grippers and (
        words[name] & _LINEAR or {'torso', 'lift'} <= words[name]))
    if len(grippers) + len(linear) == len(names):
        return []
    return ([_fact(Kind.GRIPPER, grippers, 'gripper or wheel')] * bool(grippers)
            + [_fact(Kind.LINEAR_JOINT, linear, 'linear joint')] * bool(linear))


def by_position(signals: Signals) -> list[Fact]:
    """
    Return the facts on positions that are no angles in rad: degrees, counts, linear joints.

    If at least half of the joints exceed the range of angles, the unit of all is wrong.
    """
    largest = np.quantile(np.abs(signals.q), 0.98, axis=0)
    beyond = largest > FACTS.max_angle
    if not beyond.any():
        return []
    names = signals.named(beyond)
    values = dict(zip(names, largest[beyond].tolist()))
    if 2 * len(names) >= len(signals.names):
        size = f'positions reach {largest.max():.0f} rad'
        whole = (signals.q == np.rint(signals.q)).all() and largest.max() > 400
        what = 'are they counts of an encoder?' if whole else 'are they degrees?'
        unit = 'ticks=4096, the counts per turn,' if whole else 'deg'
        option = f'--position-unit {unit} converts them; --accept angle_unit if they are rad'
        return [Fact(Kind.ANGLE_UNIT, names, size, Action.REFUSED, what, option, values)]
    inside = [name for name in names if name in signals.names[1:-1]]
    facts = []
    if inside:
        rest = ','.join(name for name in signals.names if name not in inside)
        units = ','.join(f'{name}=deg' for name in inside)
        facts.append(Fact(
            Kind.ANGLE_UNIT, tuple(inside), f'position of {_reach(inside, values)} is no angle in '
            f'rad, among joints of the arm', Action.REFUSED, 'is it in degrees?',
            f'--position-unit {units} converts it; --joints {rest} leaves it out',
            {name: values[name] for name in inside}))
    ends = tuple(name for name in names if name not in inside)
    if ends:
        facts.append(_fact(
            Kind.LINEAR_JOINT, ends, f'position of {_reach(ends, values)} is no angle in rad: a '
            f'linear joint or a gripper', {name: values[name] for name in ends}))
    return facts


def _reach(names: Sequence[str], values: dict[str, float]) -> str:
    return ', '.join(f'{name} ({values[name]:.0f})' for name in names)


def small_degrees(signals: Signals) -> list[Fact]:
    """
    Return the fact that angles within the range of joints are degrees.

    Gravity is nearly linear in a few degrees, and periodic in radians over half a turn.
    """
    if len(signals) < FACTS.min_samples:
        return []
    part = signals.keep(np.isin(np.arange(len(signals)),
                                evenly_picked(len(signals), FACTS.max_samples)))
    wide = np.ptp(part.q, axis=0) > np.pi
    if np.count_nonzero(wide) < 2:
        return []
    ratios = {}
    for n, name in enumerate(signals.names):
        tau = part.tau[:, n]
        friction = np.column_stack([np.ones(len(part)), friction_columns(part.qd[:, n])])
        lines, waves = (without(np.column_stack([friction, *columns]), tau).var() for columns in (
            (part.q,), (np.sin(part.q), np.cos(part.q))))
        # A joint with little gravity follows lines nearly as well as waves.
        if min(lines, waves) < FACTS.better ** 2 * without(friction, tau).var():
            ratios[name] = float(lines / max(waves, 1e-18))
    if not ratios or max(ratios.values()) > FACTS.better:
        return []
    names = tuple(ratios)
    return [Fact(
        Kind.ANGLE_UNIT, names, f'the effort of {", ".join(names)} is linear in angles of '
        f'{np.ptp(part.q, axis=0).max():.2g} rad of travel, not periodic', Action.REFUSED,
        'are they degrees?', '--position-unit deg converts them; --accept angle_unit if they are '
        'rad', ratios)]


def _fact(kind: Kind, names: tuple[str, ...], why: str,
          values: dict[str, float] | None = None) -> Fact:
    has = 'has' if len(names) == 1 else 'each have'
    evidence = why if values else f'{", ".join(names)} {has} the name of a {why}'
    return Fact(kind, names, evidence, Action.LEFT_OUT, 'left out', _KEEP, values or {})
