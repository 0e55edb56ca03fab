"""Units of time, angle, torque and current in recordings, by option value."""

from __future__ import annotations

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


def is_ticks(unit: str | None) -> bool:
    """Return whether a unit of position is counts of an encoder."""
    return unit is not None and bool(_TICKS.match(unit))
