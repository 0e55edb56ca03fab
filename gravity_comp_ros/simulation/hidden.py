"""Hidden effects of simulated recordings by name: `EFFECT:JOINT[=SIZE]`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
import textwrap
from typing import Any, TYPE_CHECKING

from gravity_comp_ros.data.samples import joint_named
from gravity_comp_ros.errors import OptionError
import numpy as np
if TYPE_CHECKING:
    # Imports pinocchio, which the help of `synth` does not need.
    from gravity_comp_ros.simulation.arms import Arm
    from gravity_comp_ros.simulation.synthesise import Disturbance

# Default size of relative effects, in noise levels: visible, but small against gravity.
_NOISE_LEVELS = 10.0
# Torque noise of large joints and of the wrist, N·m, and the number of wrist joints.
_LARGE_JOINT_NOISE, _WRIST_NOISE, _WRIST_JOINTS = 0.1, 0.03, 3


@dataclass(frozen=True)
class Kind:
    """
    A kind of hidden effect.

    `unit` of its size is that of `diagnose` for the same effect. The default `size` is in this
    unit, or in tens of noise levels of the joint if `relative`. `make` takes the package
    `disturbances`, arm, joint and size. `signed` sizes may be negative. Effects of the
    `whole_arm` have no joint.
    """

    unit: str
    meaning: str
    size: float
    relative: bool
    make: Callable[[Any, Arm, int, float], Disturbance]
    signed: bool = False
    whole_arm: bool = False


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
    from gravity_comp_ros.simulation.arms import gravity_torque
    poses = np.random.default_rng(0).uniform(arm.lower, arm.upper, (_POSES, arm.n_joints))
    load = float(np.abs(gravity_torque(arm, poses)[:, joint]).max())
    return float(np.clip(_RELATIVE_PRELOAD * load, _MIN_PRELOAD, _MAX_PRELOAD))


KINDS: dict[str, Kind] = {
    'coulomb_friction': Kind('N·m', 'Coulomb friction', 1.0, True,
                             lambda d, arm, j, x: d.Friction(j, d.LuGre(x))),
    'viscous_friction': Kind('N·m·s/rad', 'viscous friction', 4.0, True,
                             lambda d, arm, j, x: d.Friction(j, d.LuGre(0.0, x))),
    'stribeck_friction': Kind('N·m', 'static friction beyond a Coulomb friction of the same size',
                              1.0, True,
                              lambda d, arm, j, x: d.Friction(j, d.LuGre(x, static=2 * x))),
    'degressive_friction': Kind(
        'N·m', 'friction of grease at 1 rad/s, with a Coulomb friction of half the size', 2.0,
        True, lambda d, arm, j, x: d.Friction(j, d.LuGre(
            0.5 * x, x / (_THINNING * np.arcsinh(1.0 / _THINNING)), thinning=_THINNING))),
    'asymmetric_friction': Kind(
        'N·m', 'half the difference of friction in the two directions', 0.5, True,
        lambda d, arm, j, x: d.Friction(j, d.LuGre(3 * x), d.LuGre(3 * x).at_level(x))),
    'load_dependent_friction': Kind('', 'friction as a fraction of the load', 0.05, False,
                                    lambda d, arm, j, x: d.LoadFriction(j, x, _preload(arm, j))),
    'friction_drift': Kind('N·m', 'friction of the cold gear; it falls with warming', 2.0, True,
                           lambda d, arm, j, x: d.ThermalFriction(j, d.LuGre(x, 2 * x))),
    'presliding_hysteresis': Kind('N·m', 'friction that builds up over 0.03 rad', 1.0, True,
                                  lambda d, arm, j, x: d.Friction(j, d.LuGre(x, presliding=0.03))),
    'coupled_friction': Kind(
        'N·m', 'friction of a gear shared with the next joint', 1.0, True,
        lambda d, arm, j, x: d.DifferentialFriction(
            (j, j + 1 if j + 1 < arm.n_joints else j - 1), d.LuGre(x))),
    'torque_offset': Kind('N·m', 'torque signal at zero torque', 1.0, True,
                          lambda d, arm, j, x: d.gauge_offset(j, x), signed=True),
    'torque_gain': Kind('', 'relative error of the torque scale, 0.1 for 10 % too much', 0.1,
                        False, lambda d, arm, j, x: d.gauge_gain(j, 1 + x), signed=True),
    'torque_drift': Kind('N·m', 'change of the torque signal, most of it within 200 s', 1.0, True,
                         lambda d, arm, j, x: d.gauge_drift(j, x, _WARMING), signed=True),
    'joint_spring': Kind('N·m/rad', 'torque of a spring balancer 1 rad from its rest, over 1 rad',
                         10.0, False, lambda d, arm, j, x: d.spring_balancer(j, x)),
    'cable_stiffness': Kind('N·m/rad', 'stiffness of a cable that is taut beyond 0.3 rad', 2.0,
                            True, lambda d, arm, j, x: d.dress_pack(j, 0.3, x)),
    'torque_ripple': Kind('N·m', 'amplitude of a ripple of 12 periods per revolution', 1.0, True,
                          lambda d, arm, j, x: d.cogging(j, 12, x)),
    'encoder_offset': Kind('rad', 'true minus reported angle', 0.03, False,
                           lambda d, arm, j, x: d.encoder_offset(j, x), signed=True),
    'end_stop': Kind('N·m/rad', 'stiffness of a bumper at half the upper limit', 30.0, True,
                     lambda d, arm, j, x: d.bumper(j, 0.5 * float(arm.upper[j]), x)),
    'joint_flexibility': Kind('rad/(N·m)', 'compliance of the gear', 1 / 6000.0, False,
                              lambda d, arm, j, x: d.gear(j, lambda load: x * load)),
    'backlash': Kind('rad', 'play of the gear', 0.02, False,
                     lambda d, arm, j, x: d.gear(j, lambda load: 0.5 * x * np.tanh(2.0 * load))),
    'detent': Kind('N·m', 'largest torque of a detent at 0.5 rad', 4.0, True,
                   lambda d, arm, j, x: d.detent(j, 0.5, x)),
    'base_tilt': Kind('rad', 'roll of the base', 0.035, False,
                      lambda d, arm, j, x: d.tilted_base(x), signed=True, whole_arm=True),
    'time_delay': Kind('s', 'delay of torque relative to position', 0.04, False,
                       lambda d, arm, j, x: d.delayed_effort(x), whole_arm=True),
    'tool_force': Kind('N', 'force on the tool, fixed in its frame', 12.0, False,
                       lambda d, arm, j, x: d.tool_force((0.5 * x, 0.25 * x, -x)), whole_arm=True),
}


def size_table() -> str:
    """Return a text table of the effects with unit and meaning of their size."""
    lines = []
    for name, kind in sorted(KINDS.items()):
        place = '' if kind.whole_arm else ':JOINT'
        unit = f'{kind.unit}: ' if kind.unit else ''
        lines += textwrap.wrap(f'  {name + place:<30}{unit}{kind.meaning}', 79,
                               subsequent_indent=' ' * 34)
    return '\n'.join(lines)


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
    from gravity_comp_ros.simulation import disturbances
    kind = KINDS[name]
    if kind.whole_arm and where:
        raise OptionError(f'{name} acts on the whole arm; remove :{where}')
    joint = 0 if kind.whole_arm else _joint(name, where, arm)
    size = kind.size * (_NOISE_LEVELS * noise_levels(arm)[joint] if kind.relative else 1.0)
    if equals:
        size = _number(text, number, kind)
    return Hidden(name, None if kind.whole_arm else arm.joints[joint], size, kind.unit,
                  kind.make(disturbances, arm, joint, size))


def _joint(name: str, where: str, arm: Arm) -> int:
    if not where:
        raise OptionError(f'{name}: on which joint? Write {name}:JOINT or {name}:JOINT=SIZE; '
                          f'there are {", ".join(arm.joints)}, or 1 to {arm.n_joints}')
    joint = joint_named(where, arm.joints)
    if joint is not None:
        return arm.joints.index(joint)
    raise OptionError(f'no joint {where}; there are {", ".join(arm.joints)}, or 1 to '
                      f'{arm.n_joints}')


def _number(text: str, number: str, kind: Kind) -> float:
    try:
        size = float(number)
    except ValueError:
        size = float('nan')
    if not isfinite(size):
        raise OptionError(f'{text}: the size {number!r} is not a number')
    if size == 0.0 or size < 0.0 and not kind.signed:
        raise OptionError(f'{text}: the size is {number}; it must be '
                          f'{"other than" if kind.signed else "above"} 0 {kind.unit}'.rstrip())
    return size
