"""Sizes of hidden effects: units, meanings and largest values."""

from __future__ import annotations

from dataclasses import dataclass
import textwrap


@dataclass(frozen=True)
class Size:
    """
    Size of a hidden effect.

    `unit` is that of `diagnose` for the same effect; `maximum` is the largest plausible size.
    `signed` sizes may be negative. Effects of the `whole_arm` have no joint.
    """

    unit: str
    meaning: str
    maximum: float
    signed: bool = False
    whole_arm: bool = False


_TORQUE, _STIFF = 300.0, 1e4

SIZES: dict[str, Size] = {
    'coulomb_friction': Size('N·m', 'Coulomb friction', _TORQUE),
    'viscous_friction': Size('N·m·s/rad', 'viscous friction', 1000.0),
    'stribeck_friction': Size('N·m', 'static friction beyond a Coulomb friction of the same size',
                              _TORQUE),
    'degressive_friction': Size('N·m', 'friction of grease at 1 rad/s, with a Coulomb friction '
                                'of half the size', _TORQUE),
    'asymmetric_friction': Size('N·m', 'half the difference of friction in the two directions',
                                _TORQUE),
    'load_dependent_friction': Size('', 'friction as a fraction of the load', 1.0),
    'friction_drift': Size('N·m', 'friction of the cold gear; it falls with warming', _TORQUE),
    'presliding_hysteresis': Size('N·m', 'friction that builds up over 0.03 rad', _TORQUE),
    'coupled_friction': Size('N·m', 'friction of a gear shared with the next joint', _TORQUE),
    'torque_offset': Size('N·m', 'torque signal at zero torque', _TORQUE, True),
    'torque_gain': Size('', 'relative error of the torque scale, 0.1 for 10 % too much', 0.9,
                        True),
    'torque_drift': Size('N·m/s', 'change of the torque signal per second at the start; it fades '
                         'within 200 s', 1.0, True),
    'joint_spring': Size('N·m/rad', 'torque of a spring balancer 1 rad from its rest, over 1 rad',
                         _STIFF),
    'cable_stiffness': Size('N·m/rad', 'stiffness of a cable that is taut beyond 0.3 rad', _STIFF),
    'torque_ripple': Size('N·m', 'amplitude of a ripple of 12 periods per revolution', _TORQUE),
    'encoder_offset': Size('rad', 'true minus reported angle', 0.5, True),
    'end_stop': Size('N·m/rad', 'stiffness of a bumper at half the upper limit', _STIFF),
    'joint_flexibility': Size('rad/(N·m)', 'compliance of the gear', 0.02),
    'backlash': Size('rad', 'play of the gear', 0.2),
    'detent': Size('N·m', 'largest torque of a detent at 0.5 rad', _TORQUE),
    'base_tilt': Size('rad', 'roll of the base', 0.5, True, True),
    'time_delay': Size('s', 'delay of torque relative to position', 1.0, False, True),
    'tool_force': Size('N', 'force on the tool, fixed in its frame', 1000.0, False, True),
}


def size_table() -> str:
    """Return a text table of the effects with unit and meaning of their size."""
    lines = []
    for name, size in sorted(SIZES.items()):
        place = '' if size.whole_arm else ':JOINT'
        unit = f'{size.unit}: ' if size.unit else ''
        lines += textwrap.wrap(f'  {name + place:<30}{unit}{size.meaning}', 79,
                               subsequent_indent=' ' * 34)
    return '\n'.join(lines)
