"""`Signals`: recorded arrays while they are judged, and stretches of equal values in them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
import numpy as np
from numpy.typing import NDArray

# Stretches that are listed, at most.
_MAX_SPANS = 3


@dataclass(frozen=True, eq=False)
class Signals:
    """
    M samples of N joints: t (M,) in s; q, qd, tau (M, N) as recorded; `rows` (M,) of the original.

    `scaled` (N,) are the joints whose unit of effort was given.
    """

    names: tuple[str, ...]
    t: FloatArray
    q: FloatArray
    qd: FloatArray
    tau: FloatArray
    rows: IntArray
    scaled: BoolArray

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
        return replace(self, t=self.t[mask], q=self.q[mask], qd=self.qd[mask],
                       tau=self.tau[mask], rows=self.rows[mask])

    def without(self, joints: BoolArray) -> Signals:
        """Return the signals without the joints of a mask (N,)."""
        if not joints.any():
            return self
        rest = ~joints
        names = tuple(name for name, kept in zip(self.names, rest) if kept)
        return replace(self, names=names, q=self.q[:, rest], qd=self.qd[:, rest],
                       tau=self.tau[:, rest], scaled=self.scaled[rest])

    def thinned(self, count: int) -> Signals:
        """Return at most `count` samples, evenly spaced."""
        step = -(-max(len(self), 1) // count)
        return self.keep(np.arange(len(self)) % step == 0)

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
