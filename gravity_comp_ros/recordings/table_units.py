"""Whether the units of a table can be what they are taken for; asked about, never guessed."""

from __future__ import annotations

from pathlib import Path

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.units import TIME_UNITS
import numpy as np

# A joint that travels as far, rad, moves; a usual speed of one that does, rad/s.
_MOVES, _USUAL = 0.05, 0.3
# Fastest joint on average, rad/s: slower than the first is no motion at any rate, slower than the
# second none between samples that are half a second apart and more.
_SLOWEST, _SLOWEST_SELDOM, _SELDOM = 5e-4, 5e-3, 0.5
# No arm turns as far, rad: two turns to either side.
_FURTHEST = 4 * np.pi
# Ratios of a measured velocity to the change of the position agree within this factor.
_SAME = 1.25
_DEGREES = 180 / np.pi


def check_angles(path: Path, q: FloatArray) -> None:
    """
    Refuse angles (M, N) that are surely not in rad.

    :raises BagError: if they reach further than joints turn.
    """
    most = float(np.abs(q).max())
    if most > _FURTHEST:
        raise BagError(f'{path}: positions reach {most:.0f} rad: are they degrees? Give '
                       f'--angle-unit deg, or rad if that is right')


def check_seconds(path: Path, t: FloatArray, q: FloatArray) -> None:
    """
    Refuse times (M,) that are surely not in s: in them the fastest joint would hardly move.

    :raises BagError: if another unit gives the speed of a moving arm.
    """
    length, travel = float(t[-1] - t[0]), float(np.ptp(q, axis=0).max())
    if len(t) < 10 or travel < _MOVES:
        return
    speed = float(np.abs(np.diff(q, axis=0)).sum(axis=0).max()) / length
    seldom = float(np.median(np.diff(t))) >= _SELDOM
    if speed >= (_SLOWEST_SELDOM if seldom else _SLOWEST):
        return
    unit = min(('ms', 'us', 'ns'), key=lambda u: abs(np.log(speed / TIME_UNITS[u] / _USUAL)))
    raise BagError(f'{path}: with time in s the recording lasts {length:.3g} s and no joint moves '
                   f'faster than {speed:.2g} rad/s on average: give --time-unit {unit}, or s if '
                   f'that is right')


def check_velocity(path: Path, t: FloatArray, q: FloatArray, qd: FloatArray,
                   time_known: bool) -> None:
    """
    Refuse velocities (M, N) that are not how fast the positions (M, N) change.

    :param time_known: whether the unit of the time was given.
    :raises BagError: if another unit of one of them explains it, or their signs differ.
    """
    ratio = _velocity_per_change(t, q, qd)
    if ratio is None or 1 / _SAME < ratio < _SAME:
        return
    for unit, size in TIME_UNITS.items():
        if not time_known and unit != 's' and 1 / _SAME < ratio * size < _SAME:
            raise BagError(f'{path}: the velocity is {1 / size:.0e} times the change of the '
                           f'position: give --time-unit {unit}')
    wrong = {1 / _DEGREES: 'the positions are in degrees and the velocity in rad/s',
             _DEGREES: 'the positions are in rad and the velocity in degrees/s',
             -1.0: 'the velocity has the other sign'}
    for size, words in wrong.items():
        if 1 / _SAME < ratio / size < _SAME:
            unit = '--angle-unit deg, ' if size < 1 and size > 0 else ''
            raise BagError(f'{path}: it seems that {words}: give {unit}--velocity none, which '
                           f'takes the velocity from the positions')


def _velocity_per_change(t: FloatArray, q: FloatArray, qd: FloatArray) -> float | None:
    """Return the slope of the integrated velocity on the change of position, over spans."""
    span = max(len(t) // 20, 10)
    if len(t) < 5 * span or not (np.ptp(q, axis=0) > _MOVES).any():
        return None
    way = np.zeros_like(q)
    way[1:] = np.cumsum(0.5 * (qd[1:] + qd[:-1]) * np.diff(t)[:, None], axis=0)
    change, integral = q[span:] - q[:-span], way[span:] - way[:-span]
    slopes = [float(i @ c / (c @ c)) for c, i, travel in zip(
        change.T, integral.T, np.ptp(q, axis=0)) if travel > _MOVES and i.any()]
    return float(np.median(slopes)) if slopes else None
