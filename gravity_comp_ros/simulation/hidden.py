"""What can be hidden in a recording by name: `EFFECT[:JOINT[=SIZE]]`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite, radians

from gravity_comp_ros.data.joint_names import joint_named
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.cases import noise_levels
from gravity_comp_ros.simulation.disturbances.backlash import Backlash
from gravity_comp_ros.simulation.disturbances.balancer import SpringBalancer
from gravity_comp_ros.simulation.disturbances.bumper import Bumper
from gravity_comp_ros.simulation.disturbances.cogging import Cogging
from gravity_comp_ros.simulation.disturbances.detent import Detent
from gravity_comp_ros.simulation.disturbances.dress_pack import DressPack
from gravity_comp_ros.simulation.disturbances.encoder import EncoderOffset
from gravity_comp_ros.simulation.disturbances.friction import Friction
from gravity_comp_ros.simulation.disturbances.late_effort import LateEffort
from gravity_comp_ros.simulation.disturbances.load_friction import LoadFriction
from gravity_comp_ros.simulation.disturbances.lugre import LuGre
from gravity_comp_ros.simulation.disturbances.mounting import TiltedBase
from gravity_comp_ros.simulation.disturbances.shafts import DifferentialFriction
from gravity_comp_ros.simulation.disturbances.soft_gear import SoftGear
from gravity_comp_ros.simulation.disturbances.strain_gauge import GaugeDrift, GaugeGain, GaugeZero
from gravity_comp_ros.simulation.disturbances.tool_jet import ToolJet
from gravity_comp_ros.simulation.disturbances.warm_friction import WarmFriction
from gravity_comp_ros.simulation.synthesise import Disturbance

# A torque that stands out of a joint's usual noise without drowning its gravity.
_ABOVE_NOISE = 10.0


@dataclass(frozen=True)
class Kind:
    """
    One thing to hide: how its size is counted, and what it is by default.

    `size` is the default: in `unit`, or that many times ten noise levels of the joint if
    `relative`. `make` gets arm, joint and size.
    """

    unit: str
    size: float
    relative: bool
    make: Callable[[Arm, int, float], Disturbance]
    whole_arm: bool = False


KINDS: dict[str, Kind] = {
    'coulomb_friction': Kind('N·m', 1.0, True, lambda arm, j, x: Friction(j, LuGre(x))),
    'viscous_friction': Kind('N·m·s/rad', 4.0, True,
                             lambda arm, j, x: Friction(j, LuGre(0.0, x))),
    'stribeck_friction': Kind('N·m', 1.0, True,
                              lambda arm, j, x: Friction(j, LuGre(x, static=2 * x))),
    'asymmetric_friction': Kind('N·m', 1.0, True, lambda arm, j, x: Friction(
        j, LuGre(1.5 * x), LuGre(0.5 * x))),
    'load_dependent_friction': Kind('', 0.05, False, lambda arm, j, x: LoadFriction(j, x)),
    'friction_drift': Kind('N·m', 2.0, True,
                           lambda arm, j, x: WarmFriction(j, LuGre(x, 2 * x))),
    'presliding_hysteresis': Kind('N·m', 1.0, True, lambda arm, j, x: Friction(
        j, LuGre(x, presliding=0.03))),
    'coupled_friction': Kind('N·m', 1.0, True, lambda arm, j, x: DifferentialFriction(
        (j, j + 1 if j + 1 < arm.n_joints else j - 1), LuGre(x))),
    'torque_offset': Kind('N·m', 1.0, True, lambda arm, j, x: GaugeZero(j, x)),
    'torque_gain': Kind('', 0.1, False, lambda arm, j, x: GaugeGain(j, 1 + x)),
    'torque_drift': Kind('N·m', 1.0, True, lambda arm, j, x: GaugeDrift(j, x)),
    'joint_spring': Kind('N/m', 1000.0, False,
                         lambda arm, j, x: SpringBalancer(j, x, free=0.5, post=0.6)),
    'cable_stiffness': Kind('N·m/rad', 2.0, True, lambda arm, j, x: DressPack(j, 0.3, x)),
    'torque_ripple': Kind('N·m', 1.0, True, lambda arm, j, x: Cogging(j, 12, x)),
    'encoder_offset': Kind('rad', 0.03, False, lambda arm, j, x: EncoderOffset(j, x)),
    'end_stop': Kind('N·m/rad', 30.0, True,
                     lambda arm, j, x: Bumper(j, 0.5 * float(arm.upper[j]), x)),
    'joint_flexibility': Kind('N·m/rad', 6000.0, False, lambda arm, j, x: SoftGear(j, x)),
    'backlash': Kind('rad', 0.02, False, lambda arm, j, x: Backlash(j, x)),
    'detent': Kind('N·m', 4.0, True, lambda arm, j, x: Detent(j, 0.5, x)),
    'base_tilt': Kind('deg', 2.0, False, lambda arm, j, x: TiltedBase(radians(x), 0.0), True),
    'time_delay': Kind('s', 0.04, False, lambda arm, j, x: LateEffort(x), True),
    'tool_force': Kind('N', 12.0, False,
                       lambda arm, j, x: ToolJet((0.5 * x, 0.25 * x, -x)), True),
}


def hidden(text: str, arm: Arm) -> Disturbance:
    """
    Return what `EFFECT[:JOINT[=SIZE]]` names, JOINT a name or a number from 1.

    Without a joint it is the second one, that carries most; an effect of the whole arm takes
    its size as `EFFECT=SIZE`.

    :raises OptionError: if effect or joint is unknown, or the size is no number.
    """
    place, _, number = text.partition('=')
    name, _, where = place.partition(':')
    if name not in KINDS:
        raise OptionError(f'cannot hide {name!r}; there are {", ".join(sorted(KINDS))}')
    kind = KINDS[name]
    if kind.whole_arm and where:
        raise OptionError(f'{name} acts on the whole arm; leave :{where} away')
    joint = _joint(where, arm)
    size = kind.size
    if number:
        size = _number(text, number)
    elif kind.relative:
        size *= _ABOVE_NOISE * noise_levels(arm)[joint]
    return kind.make(arm, joint, size)


def _joint(where: str, arm: Arm) -> int:
    if not where:
        return min(1, arm.n_joints - 1)
    joint = joint_named(where, arm.joints)
    if joint is not None:
        return arm.joints.index(joint)
    raise OptionError(f'no joint {where}; there are {", ".join(arm.joints)}, or 1 to '
                      f'{arm.n_joints}')


def _number(text: str, number: str) -> float:
    try:
        size = float(number)
    except ValueError:
        size = float('nan')
    if not isfinite(size):
        raise OptionError(f'{text}: the size {number!r} is not a number')
    return size
