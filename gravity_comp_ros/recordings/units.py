"""Units of time, angle, torque and current in recordings, by option value."""

from __future__ import annotations

from collections.abc import Collection
from math import pi
import re

from gravity_comp_ros.errors import OptionError

TIME_UNITS = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}
ANGLE_UNITS = {'rad': 1.0, 'deg': pi / 180}
ANGLE_HELP = 'rad, deg or ticks=N, N counts of an encoder per turn'
# Torque per unit, N·m.
TORQUE_UNITS = {'Nm': 1.0, 'mNm': 1e-3, 'Ncm': 1e-2, 'kgfcm': 0.0980665, 'kgfm': 9.80665,
                'lbfft': 1.3558179483314004, 'lbfin': 0.1129848290276167}
# Current per unit, A; conversion to torque requires a torque constant.
CURRENT_UNITS = {'A': 1.0, 'mA': 1e-3}
# Share per unit; conversion to torque requires the rated torque.
SHARE_UNITS = {'percent': 1e-2, 'permille': 1e-3}
EFFORT_UNITS = {**TORQUE_UNITS, **CURRENT_UNITS, **SHARE_UNITS}

_TICKS = re.compile(r'ticks=(\d+)$')


def radians_per_unit(unit: str) -> float:
    """
    Return the rad per unit of position: `rad`, `deg`, or `ticks=N` for N counts per turn.

    :raises OptionError: if the unit is unknown.
    """
    ticks = _TICKS.match(unit)
    if ticks and int(ticks[1]):
        return 2 * pi / int(ticks[1])
    if unit not in ANGLE_UNITS:
        raise OptionError(f'position unit {unit!r} is not {ANGLE_HELP}')
    return ANGLE_UNITS[unit]


def check_effort_unit(unit: str, units: Collection[str], is_rated: bool) -> None:
    """
    Check a unit of effort.

    :param units: the known units.
    :param is_rated: whether rated torques are given, of which a share is a torque.
    :raises OptionError: if it is unknown, or rated torques are missing or without use.
    """
    if unit not in units:
        raise OptionError(f'effort unit {unit!r} is not one of {", ".join(units)}')
    is_share = unit in SHARE_UNITS
    if is_share != is_rated:
        raise OptionError('effort in per cent or per mille needs a rated torque in N·m'
                          if is_share else 'a rated torque is for effort in percent or permille')


def is_ticks(unit: str | None) -> bool:
    """Return whether a unit of position is counts of an encoder."""
    return unit is not None and bool(_TICKS.match(unit))
