"""What is said of a recording while it is read: gaps, units, speeds and efforts of 0."""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.samples import BoolArray, FloatArray
import numpy as np

# No position in rad, speed or effort in any driver's unit is larger.
IMPOSSIBLE = 1e9
# A gap is longer than this, s, and than so many usual intervals.
GAP, GAP_STEPS = 10.0, 100.0
# Rows that are looked at together, so that little memory is needed beside them.
_AT_ONCE = 65536


def drop_impossible(*arrays: FloatArray) -> int:
    """Put NaN for what is finite and yet no measurement, and return how many that was."""
    count = 0
    for values in arrays:
        for start in range(0, len(values), _AT_ONCE):
            part = values[start:start + _AT_ONCE]
            beyond = np.isfinite(part) & (np.abs(part) > IMPOSSIBLE)
            part[beyond] = np.nan
            count += int(beyond.sum())
    return count


def gap_notes(t: FloatArray) -> list[str]:
    """
    Say where a recording has a hole that no lost message explains.

    :param t: times (M,) in s, rising.
    """
    steps = np.diff(t)
    if not steps.size:
        return []
    longest = int(np.argmax(steps))
    count = int((steps > max(GAP, GAP_STEPS * float(np.median(steps)))).sum())
    if not count:
        return []
    what = 'a gap of' if count == 1 else f'{count} gaps, the longest'
    return [f'{what} {steps[longest]:.4g} s, {t[longest]:.4g} s after the start: if the arm or '
            f'its load changed in between, these are two recordings']


def degree_notes(furthest: float, degrees: bool) -> list[str]:
    """Ask for the unit of angles of which the largest is `furthest`."""
    if degrees or furthest <= 4 * np.pi:
        return []
    return [f'positions reach {furthest:.0f} rad: are they degrees? --degrees reads them so']


def zero_effort_note(joint: str) -> str:
    """Return the note on a joint whose effort never differs from 0."""
    return f'effort of joint {joint} is always 0'


def zero_velocity_notes(joints: Sequence[str], moves: BoolArray, speed: BoolArray) -> list[str]:
    """
    Say where a driver publishes 0 for a speed that it does not measure.

    :param moves: which joints move (N,).
    :param speed: which joints have a velocity other than 0, or one to be differentiated (N,).
    """
    zero = moves & ~speed
    if not zero.any():
        return []
    if not speed.any():
        return ['velocity is 0 throughout although joints move: taken as a series of poses at '
                'rest; if the driver does not measure velocity, read it with --differentiate']
    return [f'velocity of {", ".join(np.array(joints)[zero])} is 0 throughout although it '
            f'moves: the driver does not measure it; read it with --differentiate']
