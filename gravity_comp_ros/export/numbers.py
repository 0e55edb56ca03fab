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


@dataclass(frozen=True, eq=False)
class Parameters:
    """
    The numbers of a model, `values` (K,), and a label with the unit of each.

    `layout` is the CRC-32 of the labels: arrays of the same layout have the same meaning.
    """

    labels: tuple[str, ...]
    values: FloatArray

    @property
    def layout(self) -> int:
        return zlib.crc32('\n'.join(self.labels).encode())


@dataclass
class Numbers:
    """
    Numbers in the order in which the code uses them.

    `positive` are the indices of those that the code divides by.
    """

    labels: list[str] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    positive: list[int] = field(default_factory=list)

    def add(self, label: str, value: float, positive: bool = False) -> str:
        """Add a number and return the C expression that reads it."""
        if positive:
            self.positive.append(len(self.values))
        self.labels.append(label)
        self.values.append(float(value))
        return f'gc_p[{len(self.values) - 1}]'

    def add_all(self, labels: Iterable[str], values: Iterable[float]) -> int:
        """Add numbers and return the index of the first."""
        start = len(self.values)
        for label, value in zip(labels, values):
            self.add(label, value)
        return start

    def parameters(self) -> Parameters:
        """Return the numbers with their labels."""
        return Parameters(tuple(self.labels), np.array(self.values))
