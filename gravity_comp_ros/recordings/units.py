"""Units of time, angle, torque and current in recordings, by option value."""

from __future__ import annotations

from math import pi

TIME_UNITS = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}
ANGLE_UNITS = {'rad': 1.0, 'deg': pi / 180}
# Torque per unit, N·m.
TORQUE_UNITS = {'Nm': 1.0, 'mNm': 1e-3, 'Ncm': 1e-2, 'kgfcm': 0.0980665, 'kgfm': 9.80665,
                'lbfft': 1.3558179483314004, 'lbfin': 0.1129848290276167}
# Current per unit, A; conversion to torque requires a torque constant.
CURRENT_UNITS = {'A': 1.0, 'mA': 1e-3}
