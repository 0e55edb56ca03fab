"""Sizes of what can be hidden in a recording: units, meanings, and where they end being sizes."""

from __future__ import annotations

from dataclasses import dataclass
import textwrap


@dataclass(frozen=True)
class Size:
    """
    What the number behind an effect means.

    `unit` is the one in which `diagnose` reports the effect, where it knows the effect; `most`
    is the largest size that is still an arm's. `signed` sizes may be negative. Effects of the
    `whole_arm` have no joint.
    """

    unit: str
    meaning: str
    most: float
    signed: bool = False
    whole_arm: bool = False


_TORQUE, _STIFF = 300.0, 1e4

SIZES: dict[str, Size] = {
    'coulomb_friction': Size('N·m', 'Coulomb friction', _TORQUE),
    'viscous_friction': Size('N·m·s/rad', 'viscous friction', 1000.0),
    'stribeck_friction': Size('N·m', 'static friction beyond a Coulomb friction of the same size',
                              _TORQUE),
    'degressive_friction': Size('N·m', 'friction of grease at 1 rad/s, beside a Coulomb friction '
                                'of half the size', _TORQUE),
    'asymmetric_friction': Size('N·m', 'half the difference of friction up and down', _TORQUE),
    'load_dependent_friction': Size('', 'friction as a fraction of the torque carried', 1.0),
    'friction_drift': Size('N·m', 'friction of the cold gear, which falls as it warms', _TORQUE),
    'presliding_hysteresis': Size('N·m', 'friction that builds up over 0.03 rad', _TORQUE),
    'coupled_friction': Size('N·m', 'friction of a gear shared with the next joint', _TORQUE),
    'torque_offset': Size('N·m', 'torque signal at no torque', _TORQUE, True),
    'torque_gain': Size('', 'relative error of the torque scale, 0.1 for 10 % too much', 0.9,
                        True),
    'torque_drift': Size('N·m/s', 'change of the torque signal per second at the start; it fades '
                         'within 200 s', 1.0, True),
    'joint_spring': Size('N·m/rad', 'torque of a spring balancer 1 rad from its rest, over 1 rad',
                         _STIFF),
    'cable_stiffness': Size('N·m/rad', 'stiffness of a cable that is taut beyond 0.3 rad', _STIFF),
    'torque_ripple': Size('N·m', 'amplitude of a ripple, 12 times a turn', _TORQUE),
    'encoder_offset': Size('rad', 'true angle less the one that is reported', 0.5, True),
    'end_stop': Size('N·m/rad', 'stiffness of a bumper at half the upper limit', _STIFF),
    'joint_flexibility': Size('rad/(N·m)', 'compliance of the gear', 0.02),
    'backlash': Size('rad', 'play of the gear', 0.2),
    'detent': Size('N·m', 'largest torque of a detent at 0.5 rad', _TORQUE),
    'base_tilt': Size('rad', 'roll of the base', 0.5, True, True),
    'time_delay': Size('s', 'delay of torque against position', 1.0, False, True),
    'tool_force': Size('N', 'force on the tool, fixed in its frame', 1000.0, False, True),
}


def size_table() -> str:
    """Return the effects with unit and meaning of their size, a line each."""
    lines = []
    for name, size in sorted(SIZES.items()):
        place = '' if size.whole_arm else ':JOINT'
        unit = f'{size.unit}: ' if size.unit else ''
        lines += textwrap.wrap(f'  {name + place:<30}{unit}{size.meaning}', 79,
                               subsequent_indent=' ' * 34)
    return '\n'.join(lines)
