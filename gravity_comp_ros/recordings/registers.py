"""
Signed numbers in registers of servos that a table lists as unsigned.

Feetech servos set a sign bit (15 of position and speed, 10 of load); Dynamixel use the complement
of two. The encoding whose numbers change least from row to row is the right one, the same for all
joints.
"""

from __future__ import annotations

from collections.abc import Callable

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

# Maximum ratio of the changes of a joint from row to row, for which another encoding is right.
_BETTER = 0.5
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
        is_better = (after < _BETTER * before).any() or largest >= _NO_COUNT
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
