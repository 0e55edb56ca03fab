"""
Condensed samples: means over short stretches of the path.

The information in a recording grows with its poses and directions of motion, not with its length.
The path length s = sum over samples of max_n |dq_n| is divided into stretches of equal travel,
each replaced by the means of its samples. This is exact for linear terms, whose columns are
averaged as well; the error in gravity, evaluated at the mean pose, is at most travel^2 / 24 times
its second derivative. If there are too many stretches of the longest travel, every k-th is used,
so the poses stay evenly spread along the path.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.errors import OptionError
import numpy as np


@dataclass(frozen=True)
class CondenseOptions:
    """
    Limits of condensing: number of stretches, and travel of a stretch in rad.

    :raises OptionError: if a value is out of range.
    """

    max_stretches: int = 1000
    max_travel: float = 0.02
    min_travel: float = 2e-3

    def __post_init__(self) -> None:
        if self.max_stretches < 10:
            raise OptionError(f'condense: max_stretches is {self.max_stretches}; it must be 10 or '
                              f'more')
        if not 0.0 < self.min_travel <= self.max_travel < np.inf:
            raise OptionError(f'condense: travel of {self.min_travel} to {self.max_travel} rad; '
                              f'both must be positive, the second no smaller than the first')


@dataclass(frozen=True, eq=False)
class Condensation:
    """The stretches of M samples: first sample (m,) and number of samples (m,) of each."""

    first: IntArray
    count: IntArray
    n_samples: int

    @property
    def is_identity(self) -> bool:
        """Return whether every stretch is a single sample."""
        return len(self.first) == self.n_samples

    def mean(self, values: FloatArray) -> FloatArray:
        """Return the means (m, ...) over stretches of values (M, ...)."""
        if self.is_identity:
            return values
        if int(self.count.sum()) == self.n_samples:
            total = np.add.reduceat(values, self.first, axis=0)
        else:
            # Pairs of begin and end; every second sum is of samples between two stretches.
            ends = self.first + self.count
            bounds = np.column_stack([self.first, ends]).ravel()
            padded = np.concatenate([values, np.zeros((1, *values.shape[1:]))])
            total = np.add.reduceat(padded, bounds, axis=0)[::2]
        return np.asarray(total / self.count.reshape(-1, *[1] * (values.ndim - 1)))

    def samples(self, samples: JointSamples) -> JointSamples:
        """Return the means of samples over stretches, time included."""
        if self.is_identity:
            return samples
        return JointSamples(samples.names, self.mean(samples.t), self.mean(samples.q),
                            self.mean(samples.qd), self.mean(samples.tau),
                            samples.runs[self.first], samples.run_labels, samples.starts,
                            None if samples.qdd is None else self.mean(samples.qdd))


def condense(samples: JointSamples, options: CondenseOptions = CondenseOptions()) -> Condensation:
    """Return stretches of the samples; few samples of a moving arm are not merged."""
    m = samples.n_samples
    if m == 0:
        return Condensation(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), 0)
    steps = np.abs(np.diff(samples.q, axis=0, prepend=samples.q[:1])).max(axis=1)
    begins = np.diff(samples.runs, prepend=-1) != 0
    steps[begins] = 0.0
    path = np.cumsum(steps)
    travel = float(np.clip(path[-1] / options.max_stretches, options.min_travel,
                           options.max_travel))
    number = np.floor(path / travel)
    new = begins | (np.diff(number, prepend=-1.0) != 0.0)
    first = np.flatnonzero(new)
    count = np.diff(np.append(first, m))
    every = -(-len(first) // options.max_stretches)
    return Condensation(first[::every], count[::every], m)
