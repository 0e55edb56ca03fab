"""List of hidden-effect cases of each arm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians

from bench.cases.cases import ARMS, Case, Pair, Truth
from bench.cases.signals import Grasp
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Payload
from gravity_comp_ros.simulation.disturbances.friction import (
    DifferentialFriction, Friction, GreasedGear, LoadFriction, LuGre, ThermalFriction)
from gravity_comp_ros.simulation.disturbances.joint_torque import (
    Bumper, Cogging, Detent, DressPack, SpringBalancer)
from gravity_comp_ros.simulation.disturbances.signals import (
    Backlash, DelayedEffort, ElasticGear, EncoderOffset, GaugeDrift, GaugeGain, GaugeOffset,
    TiltedBase, ToolForce)


@dataclass(frozen=True)
class Roles:
    """Joints of corresponding function in different arms, counted from 0."""

    base: int
    shoulder: int
    elbow: int
    wrist: int
    pair: tuple[int, int]
    count: int


ROLES = {
    'iiwa7': Roles(base=0, shoulder=1, elbow=3, wrist=5, pair=(4, 5), count=7),
    'six_axis': Roles(base=0, shoulder=1, elbow=2, wrist=3, pair=(4, 5), count=6),
}


def cases(arm: str) -> tuple[Case, ...]:
    """
    Return the cases for an arm of `ROLES`.

    :raises OptionError: if the arm is unknown.
    """
    if arm not in ROLES:
        raise OptionError(f'no cases for arm {arm}; there are {", ".join(ROLES)}')
    roles = ROLES[arm]
    return (*_nothing(arm), *_friction(arm, roles), *_several(arm, roles),
            *_elastic(arm, roles), *_sensors(arm, roles), *_whole_arm(arm, roles),
            *_limits(arm, roles))


def case(arm: str, name: str) -> Case:
    """
    Return one case by its name.

    :raises OptionError: if there is no case of that name.
    """
    by_name = {entry.name: entry for entry in cases(arm)}
    if name not in by_name:
        raise OptionError(f'no case {name}; there are {", ".join(by_name)}')
    return by_name[name]


def _nothing(arm: str) -> tuple[Case, ...]:
    return (
        Case('nothing_white', arm, 'nothing', correlated=0.0),
        Case('nothing_correlated', arm, 'nothing', correlated=0.9, correlation=1.0),
        Case('nothing_slow', arm, 'nothing', max_speed=0.1),
    )


def _friction(arm: str, roles: Roles) -> tuple[Case, ...]:
    s, e, w = roles.shoulder, roles.elbow, roles.wrist
    return (
        Case('coulomb_large', arm, disturbances=(Friction(s, LuGre(2.0)),),
             truths=(coulomb(s, 2.0),), allowed=bristles(s)),
        Case('coulomb_small', arm, disturbances=(Friction(s, LuGre(0.15)),),
             truths=(coulomb(s, 0.15),), allowed=bristles(s)),
        Case('coulomb_wrist', arm, disturbances=(Friction(w, LuGre(0.25)),),
             truths=(coulomb(w, 0.25),), allowed=bristles(w)),
        Case('viscous', arm, disturbances=(Friction(e, LuGre(0.0, viscous=4.0)),),
             truths=(viscous(e, 4.0),)),
        Case('stribeck', arm,
             disturbances=(Friction(s, LuGre(1.5, 3.0, static=3.0, stribeck_speed=0.03)),),
             truths=(coulomb(s), Truth('stribeck_friction', s)),
             allowed=bristles(s) | {('viscous_friction', s)}),
        Case('greased', arm,
             disturbances=(GreasedGear(e, 1.5, 0.02, LuGre(1.0)),),
             truths=(Truth('degressive_friction', e),),
             allowed=bristles(e) | {('coulomb_friction', e), ('viscous_friction', e)}),
        Case('asymmetric', arm,
             disturbances=(Friction(e, LuGre(1.6, 1.0),
                                    replace(LuGre(1.6).at_level(0.8), viscous=2.5)),),
             truths=(Truth('asymmetric_friction', e, (('torque_offset', e),)),),
             allowed=bristles(e) | {('coulomb_friction', e), ('viscous_friction', e)}),
        Case('load', arm, disturbances=(LoadFriction(s, 0.05),),
             truths=(Truth('load_dependent_friction', s),),
             allowed=bristles(s) | {('coulomb_friction', s)}),
        Case('warming', arm, disturbances=(ThermalFriction(s, LuGre(2.5, 6.0)),),
             truths=(Truth('friction_drift', s),),
             allowed=bristles(s) | {('coulomb_friction', s), ('viscous_friction', s)}),
        Case('hysteresis', arm, disturbances=(Friction(s, LuGre(1.5, presliding=0.03)),),
             truths=(Truth('presliding_hysteresis', s),), allowed=frozenset({
                 ('coulomb_friction', s)})),
        *_wrist(arm, roles),
    )


def _wrist(arm: str, roles: Roles) -> tuple[Case, ...]:
    a, b = roles.pair
    coupled = tuple(Truth('coupled_friction', joint) for joint in roles.pair)
    return (
        Case('coupled_wrist', arm, disturbances=(DifferentialFriction((a, b), LuGre(0.3)),),
             truths=(coupling(a, 0.3), coupling(b, 0.3)), allowed=bristles(a, b)),
        Case('differential', arm,
             disturbances=(DifferentialFriction((a, b), LuGre(0.3, 0.1), LuGre(0.15, 0.1)),),
             truths=coupled, allowed=bristles(a, b) | frozenset(
                 (name, joint) for joint in roles.pair
                 for name in ('coulomb_friction', 'viscous_friction'))),
    )


def _several(arm: str, roles: Roles) -> tuple[Case, ...]:
    s, e, w = roles.shoulder, roles.elbow, roles.wrist
    big = roles.count - 3
    everywhere = [(1.2 - 0.2 * j, 2.0) if j < big else (0.2, 0.3) for j in range(roles.count)]
    return (
        Case('coulomb_and_viscous', arm, disturbances=(Friction(e, LuGre(0.8, viscous=2.0)),),
             truths=(coulomb(e, 0.8), viscous(e, 2.0)), allowed=bristles(e)),
        Case('coulomb_and_offset', arm,
             disturbances=(Friction(s, LuGre(1.0)), GaugeOffset(w, 0.2)),
             truths=(coulomb(s, 1.0), offset(w, 0.2)), allowed=bristles(s)),
        Case('friction_everywhere', arm,
             disturbances=tuple(Friction(j, LuGre(c, v)) for j, (c, v) in enumerate(everywhere)),
             truths=tuple(truth for j, (c, v) in enumerate(everywhere)
                          for truth in (coulomb(j, c), viscous(j, v))),
             allowed=bristles(*range(roles.count))),
    )


def _elastic(arm: str, roles: Roles) -> tuple[Case, ...]:
    s, e = roles.shoulder, roles.elbow
    balancer = SpringBalancer(s, 1000.0, free=0.5, post=0.6)
    return (
        Case('balancer', arm, disturbances=(balancer,),
             truths=(Truth('joint_spring', s, (('cable_stiffness', s),)),)),
        Case('cable', arm, disturbances=(DressPack(e, 0.4, 2.0),),
             truths=(Truth('cable_stiffness', e, (('joint_spring', e),)),)),
        Case('cogging', arm, disturbances=(Cogging(e, 12, 0.8, phase=0.1),),
             truths=(Truth('torque_ripple', e),)),
        Case('bumper', arm, disturbances=(Bumper(e, 0.9, 30.0),),
             truths=(Truth('end_stop', e, (('cable_stiffness', e),)),)),
        Case('soft_gear', arm, disturbances=(ElasticGear(s, 6000.0),),
             truths=(Truth('joint_flexibility', s, values=(1 / 6000.0,), unit='rad/(N·m)'),)),
    )


def _sensors(arm: str, roles: Roles) -> tuple[Case, ...]:
    e, w = roles.elbow, roles.wrist
    slipped = tuple((run, EncoderOffset(e, 0.03)) for run in (2, 3, 4))
    return (
        Case('offset', arm, disturbances=(GaugeOffset(roles.base, 1.0),),
             truths=(offset(roles.base, 1.0),)),
        Case('gain', arm, disturbances=(GaugeGain(e, 1.15),), truths=(Truth('torque_gain', e),)),
        Case('zero_drift', arm, disturbances=(GaugeDrift(w, 0.5, 200.0, 0.002, lag=0.25),),
             truths=(Truth('torque_drift', w),), allowed=frozenset({('torque_offset', w)})),
        Case('late_effort', arm, disturbances=(DelayedEffort(0.04),),
             truths=(Truth('time_delay', None, values=(0.04,), unit='s'),)),
        Case('encoder_slipped', arm, in_run=slipped,
             truths=(Truth('encoder_offset', e, (('payload_change', None),)),)),
        Case('encoder_unseen', arm, 'nothing', (EncoderOffset(e, 0.03),),
             allowed=frozenset({('encoder_offset', None)})),
    )


def _whole_arm(arm: str, roles: Roles) -> tuple[Case, ...]:
    load = Payload(1.5, (0.02, -0.01, 0.08))
    picked = ((2, Grasp(load, 75.0)), (3, Grasp(load)), (4, Grasp(load)))
    return (
        Case('payload_half_way', arm, in_run=picked, truths=(Truth('payload_change', None),)),
        Case('tilted_base', arm, disturbances=(TiltedBase(radians(2.0), 0.0),),
             truths=(Truth('base_tilt', None),)),
        Case('tool_force', arm, disturbances=(ToolForce((6.0, 3.0, -12.0)),),
             truths=(Truth('tool_force', None),)),
    )


def _limits(arm: str, roles: Roles) -> tuple[Case, ...]:
    s, e = roles.shoulder, roles.elbow
    return (
        Case('detent', arm, 'unexplained', (Detent(e, 0.5, 4.0),),
             truths=(Truth('detent', e),)),
        Case('backlash', arm, 'unexplained', (Backlash(s, 0.02),),
             truths=(Truth('backlash', s),)),
        Case('too_weak', arm, 'weak', (Friction(s, LuGre(0.002)),),
             truths=(coulomb(s, 0.002),)),
        Case('one_way', arm, 'untestable', (Friction(s, LuGre(1.0)),),
             truths=(coulomb(s, 1.0), offset(s)), one_way=s),
    )


def coulomb(joint: int, *level: float) -> Truth:
    return Truth('coulomb_friction', joint, values=level, unit='N·m')


def viscous(joint: int, *coefficient: float) -> Truth:
    return Truth('viscous_friction', joint, values=coefficient, unit='N·m·s/rad')


def offset(joint: int, *zero: float) -> Truth:
    return Truth('torque_offset', joint, values=zero, unit='N·m')


def coupling(joint: int, level: float) -> Truth:
    """Return the friction of a shared gear on one of its joints."""
    return Truth('coupled_friction', joint, values=(level,), unit='N·m')


def bristles(*joints: int) -> frozenset[Pair]:
    """Return the presliding hysteresis of LuGre friction at reversals."""
    return frozenset(('presliding_hysteresis', joint) for joint in joints)


assert set(ROLES) <= set(ARMS)
