"""Hidden effects of simulated recordings by name: `EFFECT:JOINT[=SIZE]`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite

from gravity_comp_ros.data.joint_names import joint_named
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm, gravity_torque
from gravity_comp_ros.simulation.disturbances.friction import (
    DifferentialFriction, Friction, GreasedGear, LoadFriction, LuGre, ThermalFriction)
from gravity_comp_ros.simulation.disturbances.joint_torque import (
    Bumper, Cogging, Detent, DressPack, SpringBalancer)
from gravity_comp_ros.simulation.disturbances.signals import (
    Backlash, DelayedEffort, ElasticGear, EncoderOffset, GaugeDrift, GaugeGain, GaugeOffset,
    TiltedBase, ToolForce)
from gravity_comp_ros.simulation.hidden_sizes import Size, SIZES
from gravity_comp_ros.simulation.synthesise import Disturbance
import numpy as np

# Default size of relative effects, in noise levels: visible, but small against gravity.
_NOISE_LEVELS = 10.0
# Torque noise of large joints and of the wrist, N·m, and the number of wrist joints.
_LARGE_JOINT_NOISE, _WRIST_NOISE, _WRIST_JOINTS = 0.1, 0.03, 3


@dataclass(frozen=True)
class Kind:
    """
    A kind of hidden effect: its default size and its disturbance.

    `size` is in the unit of `SIZES`, or in tens of noise levels of the joint if `relative`.
    `make` takes arm, joint and size.
    """

    size: float
    relative: bool
    make: Callable[[Arm, int, float], Disturbance]


@dataclass(frozen=True)
class Hidden:
    """A hidden effect, its joint (None: the whole arm), its size and unit."""

    effect: str
    joint: str | None
    size: float
    unit: str
    disturbance: Disturbance

    def __str__(self) -> str:
        place = f' on {self.joint}' if self.joint else ''
        return f'{self.effect}{place}: {self.size:.4g} {self.unit}'.rstrip()

    def to_json(self) -> dict[str, object]:
        """Return the effect as a JSON object."""
        return {'effect': self.effect, 'joint': self.joint, 'size': self.size, 'unit': self.unit}


# Time constant of the drift of a torque sensor, s.
_WARMING = 200.0
# Speed above which the friction of grease is degressive, rad/s.
_THINNING = 0.05
# Preload of a gear as a share of the joint's largest load, its limits in N·m, and the number of
# poses of which the load is computed.
_RELATIVE_PRELOAD, _MIN_PRELOAD, _MAX_PRELOAD, _POSES = 0.1, 1e-6, 3.0, 200


def _preload(arm: Arm, joint: int) -> float:
    """Return a preload in N·m: a tenth of the joint's largest load, at most 3 N·m."""
    poses = np.random.default_rng(0).uniform(arm.lower, arm.upper, (_POSES, arm.n_joints))
    load = float(np.abs(gravity_torque(arm, poses)[:, joint]).max())
    return float(np.clip(_RELATIVE_PRELOAD * load, _MIN_PRELOAD, _MAX_PRELOAD))


def _spring(joint: int, stiffness: float) -> SpringBalancer:
    """Return a balancer with a torque of `stiffness` N·m at 1 rad from its rest."""
    unit = SpringBalancer(joint, 1.0, free=0.5, post=0.6)
    return SpringBalancer(joint, stiffness / float(unit.torque(np.array(1.0))), free=0.5, post=0.6)


KINDS: dict[str, Kind] = {
    'coulomb_friction': Kind(1.0, True, lambda arm, j, x: Friction(j, LuGre(x))),
    'viscous_friction': Kind(4.0, True, lambda arm, j, x: Friction(j, LuGre(0.0, x))),
    'stribeck_friction': Kind(1.0, True, lambda arm, j, x: Friction(j, LuGre(x, static=2 * x))),
    'degressive_friction': Kind(2.0, True, lambda arm, j, x: GreasedGear(
        j, x / float(np.arcsinh(1.0 / _THINNING)), _THINNING, LuGre(0.5 * x))),
    'asymmetric_friction': Kind(0.5, True, lambda arm, j, x: Friction(
        j, LuGre(3 * x), LuGre(3 * x).at_level(x))),
    'load_dependent_friction': Kind(0.05, False, lambda arm, j, x: LoadFriction(
        j, x, _preload(arm, j))),
    'friction_drift': Kind(2.0, True, lambda arm, j, x: ThermalFriction(j, LuGre(x, 2 * x))),
    'presliding_hysteresis': Kind(1.0, True, lambda arm, j, x: Friction(
        j, LuGre(x, presliding=0.03))),
    'coupled_friction': Kind(1.0, True, lambda arm, j, x: DifferentialFriction(
        (j, j + 1 if j + 1 < arm.n_joints else j - 1), LuGre(x))),
    'torque_offset': Kind(1.0, True, lambda arm, j, x: GaugeOffset(j, x)),
    'torque_gain': Kind(0.1, False, lambda arm, j, x: GaugeGain(j, 1 + x)),
    'torque_drift': Kind(1.0 / _WARMING, True, lambda arm, j, x: GaugeDrift(
        j, x * _WARMING, _WARMING)),
    'joint_spring': Kind(10.0, False, lambda arm, j, x: _spring(j, x)),
    'cable_stiffness': Kind(2.0, True, lambda arm, j, x: DressPack(j, 0.3, x)),
    'torque_ripple': Kind(1.0, True, lambda arm, j, x: Cogging(j, 12, x)),
    'encoder_offset': Kind(0.03, False, lambda arm, j, x: EncoderOffset(j, x)),
    'end_stop': Kind(30.0, True, lambda arm, j, x: Bumper(j, 0.5 * float(arm.upper[j]), x)),
    'joint_flexibility': Kind(1 / 6000.0, False, lambda arm, j, x: ElasticGear(j, 1 / x)),
    'backlash': Kind(0.02, False, lambda arm, j, x: Backlash(j, x)),
    'detent': Kind(4.0, True, lambda arm, j, x: Detent(j, 0.5, x)),
    'base_tilt': Kind(0.035, False, lambda arm, j, x: TiltedBase(x, 0.0)),
    'time_delay': Kind(0.04, False, lambda arm, j, x: DelayedEffort(x)),
    'tool_force': Kind(12.0, False, lambda arm, j, x: ToolForce((0.5 * x, 0.25 * x, -x))),
}


def noise_levels(arm: Arm) -> tuple[float, ...]:
    """Return the torque noise of each joint in N·m; the last three are the wrist."""
    large = max(arm.n_joints - _WRIST_JOINTS, 0)
    return (_LARGE_JOINT_NOISE,) * large + (_WRIST_NOISE,) * (arm.n_joints - large)


def hidden(text: str, arm: Arm) -> Hidden:
    """
    Return the hidden effect `EFFECT:JOINT[=SIZE]`; JOINT is a name or a number from 1.

    An effect of the whole arm has no joint: `EFFECT[=SIZE]`.

    :raises OptionError: if effect or joint is unknown or missing, or the size is invalid.
    """
    place, equals, number = text.partition('=')
    name, _, where = place.partition(':')
    if name not in KINDS:
        raise OptionError(f'no hidden effect {name!r}; there are {", ".join(sorted(KINDS))}')
    kind, limits = KINDS[name], SIZES[name]
    if limits.whole_arm and where:
        raise OptionError(f'{name} acts on the whole arm; remove :{where}')
    joint = 0 if limits.whole_arm else _joint(name, where, arm)
    size = kind.size * (_NOISE_LEVELS * noise_levels(arm)[joint] if kind.relative else 1.0)
    if equals:
        size = _number(text, number, limits)
    return Hidden(name, None if limits.whole_arm else arm.joints[joint], size, limits.unit,
                  kind.make(arm, joint, size))


def _joint(name: str, where: str, arm: Arm) -> int:
    if not where:
        raise OptionError(f'{name}: on which joint? Write {name}:JOINT or {name}:JOINT=SIZE; '
                          f'there are {", ".join(arm.joints)}, or 1 to {arm.n_joints}')
    joint = joint_named(where, arm.joints)
    if joint is not None:
        return arm.joints.index(joint)
    raise OptionError(f'no joint {where}; there are {", ".join(arm.joints)}, or 1 to '
                      f'{arm.n_joints}')


def _number(text: str, number: str, limits: Size) -> float:
    try:
        size = float(number)
    except ValueError:
        size = float('nan')
    if not isfinite(size):
        raise OptionError(f'{text}: the size {number!r} is not a number')
    unit = f' {limits.unit}'.rstrip()
    if size == 0.0 or size < 0.0 and not limits.signed:
        raise OptionError(f'{text}: the size is {number}; it must be '
                          f'{"other than" if limits.signed else "above"} 0{unit}')
    if abs(size) > limits.maximum:
        raise OptionError(f'{text}: {number}{unit} is too large ({limits.meaning}); at most '
                          f'{limits.maximum:g}{unit}')
    return size
