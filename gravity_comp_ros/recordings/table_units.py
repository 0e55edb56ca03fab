"""Units of a table: plausibility checks, and signed numbers in the registers of servos."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gravity_comp_ros.data.differentiation import slope_ratios, SPAN
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.facts.fact import refused
from gravity_comp_ros.facts.joints import by_position
from gravity_comp_ros.facts.options import FACTS
from gravity_comp_ros.facts.signals import Signals
from gravity_comp_ros.recordings.units import TIME_UNITS
import numpy as np

_DEGREES = 180 / np.pi


def check_angles(path: Path, names: tuple[str, ...], t: FloatArray, q: FloatArray) -> None:
    """
    Check that positions (M, N) can be in rad; single linear joints are left to the reader.

    :raises BagError: if they exceed the range of joints.
    """
    signals = Signals(names, t, q, q, q, np.arange(len(q)))
    for fact in refused(by_position(signals)):
        unit = 'ticks=4096 (the counts per turn)' if 'counts' in fact.done else 'deg'
        raise BagError(f'{path}: {fact.evidence}: {fact.done} Give --position-unit {unit}, or rad '
                       f'if that is right')


def check_seconds(path: Path, t: FloatArray, q: FloatArray) -> None:
    """
    Check that times (M,) can be in s, from the mean speed of the fastest joint.

    :raises BagError: if the speed is implausibly small; the message suggests a unit.
    """
    duration, travel = float(t[-1] - t[0]), float(np.ptp(q, axis=0).max())
    if len(t) < 10 or travel < FACTS.min_motion:
        return
    speed = float(np.abs(np.diff(q, axis=0)).sum(axis=0).max()) / duration
    # Units smaller than a second have long intervals, read as seconds.
    if speed >= FACTS.min_speed or float(np.median(np.diff(t))) < FACTS.long_interval:
        return
    unit = next((u for u, size in TIME_UNITS.items() if speed / size >= FACTS.min_speed), 'ns')
    raise BagError(f'{path}: with time in s the recording lasts {duration:.3g} s and no joint '
                   f'moves faster than {speed:.2g} rad/s on average: give --time-unit {unit}, or '
                   f's if that is right')


def check_velocity(path: Path, t: FloatArray, q: FloatArray, qd: FloatArray,
                   time_known: bool) -> None:
    """
    Check velocities (M, N) against the rate of change of the positions (M, N).

    :param time_known: whether the unit of the time was given.
    :raises BagError: if they differ by a unit factor or in sign.
    """
    moving = np.ptp(q, axis=0) > FACTS.min_motion
    if len(t) < 50 or not moving.any():
        return
    # The unit of the time may be another one: ratios are those of a twentieth of the table.
    scale = SPAN / (max(len(t) // 20, 10) * float(np.median(np.diff(t))))
    ratios, _ = slope_ratios(scale * t, q[:, moving], qd[:, moving])
    if np.isnan(ratios).all():
        return
    ratio = float(np.nanmedian(ratios)) / scale
    without = '--velocity none, which computes it from the positions'
    options = {} if time_known else {1 / size: f'--time-unit {unit}'
                                     for unit, size in TIME_UNITS.items() if unit != 's'}
    options |= {1 / _DEGREES: f'--position-unit deg, or {without}', _DEGREES: without,
                -1.0: without}
    for factor, option in options.items():
        if 1 / FACTS.tolerance < ratio / factor < FACTS.tolerance:
            raise BagError(f'{path}: the velocity is {ratio:.3g} times the change of the '
                           f'position: give {option}')


# Numbers from here on are no counts of a few turns: they are encoded even if no joint passes 0.
_NO_COUNT = 2 ** 15


def decoded(values: FloatArray) -> tuple[FloatArray, str]:
    """
    Return whole numbers (M, N) as signed, and the name of their encoding, '' if they are signed.

    Numbers that are not whole, or negative somewhere, are returned as they are.
    """
    if not values.size or (values != np.rint(values)).any() or values.min() < 0:
        return values, ''
    largest, before = values.max(), _change(values)
    candidates = []
    for name, limit, decode in _ENCODINGS:
        signed = decode(values)
        after = _change(signed)
        is_better = (after < FACTS.better * before).any() or largest >= _NO_COUNT
        if limit <= largest < 2 * limit and is_better and (after <= before).all():
            candidates.append((float(after.sum()), float(np.abs(signed).max()), name, signed))
    if not candidates:
        return values, ''
    *_, name, signed = min(candidates, key=lambda entry: entry[:2])
    return signed, name


def _sign_bit(bit: int) -> Callable[[FloatArray], FloatArray]:
    return lambda x: np.where(x >= 2 ** bit, 2 ** bit - x, x)


def _complement(bits: int) -> Callable[[FloatArray], FloatArray]:
    return lambda x: np.where(x >= 2 ** (bits - 1), x - 2 ** bits, x)


# Name, smallest number with the sign, and conversion.
_ENCODINGS = (*((f'sign bit {bit}', 2.0 ** bit, _sign_bit(bit)) for bit in (10, 11, 15)),
              *((f'{bits}-bit complement', 2.0 ** (bits - 1), _complement(bits))
                for bits in (16, 32)))


def _change(values: FloatArray) -> FloatArray:
    """Return the sum of the squared steps of each column (N,): jumps outweigh noise."""
    return np.asarray((np.diff(values, axis=0) ** 2).sum(axis=0))
