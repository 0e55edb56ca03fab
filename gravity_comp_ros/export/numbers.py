"""
Numbers of an exported model in a documented order.

Every number of the generated C source is in one array. A controller can replace the whole array
(`gc_set_parameters`), so that a relearned model needs no compiler. The labels name each number;
the layout, a checksum of the labels, tells two arrays of the same length apart.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
import zlib

from gravity_comp_ros.data.samples import FloatArray
import numpy as np


@dataclass
class Numbers:
    """
    Numbers in the order in which the code uses them, with a label and its unit for each.

    `positive` are the indices of those that the code divides by, `rotations` that of the first of
    N rotations.
    """

    labels: list[str] = field(default_factory=list)
    positive: list[int] = field(default_factory=list)
    rotations: int | None = None
    _values: list[float] = field(default_factory=list)

    @property
    def values(self) -> FloatArray:
        """Return the numbers (K,)."""
        return np.array(self._values)

    @property
    def layout(self) -> int:
        """Return the CRC-32 of the labels: numbers of the same layout have the same meaning."""
        return zlib.crc32('\n'.join(self.labels).encode())

    def add(self, label: str, value: float, positive: bool = False) -> str:
        """Add a number and return the C expression that reads it."""
        if positive:
            self.positive.append(len(self.labels))
        self.labels.append(label)
        self._values.append(float(value))
        return f'gc_p[{len(self.labels) - 1}]'

    def add_all(self, labels: Iterable[str], values: Iterable[float]) -> int:
        """Add numbers and return the index of the first."""
        start = len(self.labels)
        for label, value in zip(labels, values):
            self.add(label, value)
        return start
