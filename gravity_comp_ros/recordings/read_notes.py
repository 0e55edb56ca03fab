"""Notes on a recording: values out of range, gaps."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

# Maximum magnitude of a position, velocity or effort in any unit.
MAX_MAGNITUDE = 1e9
# Minimum length of a gap, in s and in median intervals.
GAP, GAP_STEPS = 10.0, 100.0
# Rows processed together; limits the memory of temporary arrays.
_BLOCK_ROWS = 65536


def mask_out_of_range(*arrays: FloatArray) -> int:
    """Set finite values beyond `MAX_MAGNITUDE` to NaN, in place; return their number."""
    count = 0
    for values in arrays:
        for start in range(0, len(values), _BLOCK_ROWS):
            part = values[start:start + _BLOCK_ROWS]
            beyond = np.isfinite(part) & (np.abs(part) > MAX_MAGNITUDE)
            part[beyond] = np.nan
            count += int(beyond.sum())
    return count


def gap_notes(t: FloatArray) -> list[str]:
    """
    Return a note on gaps that are too long for lost messages.

    :param t: increasing times (M,) in s.
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
            f'its load changed in between, cut the recording there']
