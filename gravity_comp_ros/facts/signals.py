"""`Signals`: recorded arrays while they are judged, and stretches of equal values in them."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
import numpy as np
from numpy.typing import NDArray

# Stretches that are listed, at most.
_MAX_SPANS = 3


@dataclass(frozen=True, eq=False)
class Signals:
    """
    M samples of N joints: t (M,) in s; q, qd, tau (M, N) as recorded.

    `rows` (M,) are their numbers in the recording.
    """

    names: tuple[str, ...]
    t: FloatArray
    q: FloatArray
    qd: FloatArray
    tau: FloatArray
    rows: IntArray

    def __len__(self) -> int:
        return len(self.t)

    @property
    def interval(self) -> float:
        """Return the median interval in s, 0 for a single sample."""
        return float(np.median(np.diff(self.t))) if len(self) > 1 else 0.0

    def keep(self, mask: BoolArray) -> Signals:
        """Return the samples of a mask (M,)."""
        if mask.all():
            return self
        return Signals(self.names, self.t[mask], self.q[mask], self.qd[mask], self.tau[mask],
                       self.rows[mask])

    def without(self, joints: BoolArray) -> Signals:
        """Return the signals without the joints of a mask (N,)."""
        rest = ~joints
        return Signals(self.named(rest), self.t, self.q[:, rest], self.qd[:, rest],
                       self.tau[:, rest], self.rows)

    def named(self, mask: NDArray) -> tuple[str, ...]:
        """Return the names of the joints of a mask or of indices (N,)."""
        return tuple(np.array(self.names, dtype=object)[mask].tolist())


def stretches(mask: BoolArray) -> list[slice]:
    """Return the slices of consecutive True values of a mask (M,)."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2])]


def spans(t: FloatArray, mask: BoolArray) -> str:
    """Return the times in s of the longest stretches of a mask (M,), as text."""
    ordered = sorted(stretches(mask), key=lambda part: part.start - part.stop)
    longest = sorted(ordered[:_MAX_SPANS], key=lambda part: part.start)
    text = ', '.join(f'{t[part.start]:.4g} to {t[part.stop - 1]:.4g} s' for part in longest)
    return text + (f' and {len(ordered) - _MAX_SPANS} more' if len(ordered) > _MAX_SPANS else '')
