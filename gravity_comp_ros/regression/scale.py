"""Physical scales of an arm in a recording, from which the priors of coefficients follow."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.regression.options import EngineOptions
import numpy as np

# Share of samples below the torque scale: single spikes do not set it.
_QUANTILE = 0.995


@dataclass(frozen=True, eq=False)
class Scale:
    """
    Scales of N joints.

    `torque` (N,) in N·m is each joint's torque scale, `largest` the largest of them; `low` and
    `high` (N,) in rad are the range of the angles, `duration` in s that of the longest session.
    """

    torque: FloatArray
    largest: float
    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, samples: JointSamples, options: EngineOptions) -> Scale:
        """Return the scales of samples."""
        size = np.quantile(np.abs(samples.tau), _QUANTILE, axis=0)
        largest = max(float(size.max(initial=0.0)), 1e-9)
        return cls(np.maximum(size, options.min_scale * largest), largest,
                   samples.q.min(axis=0), samples.q.max(axis=0))
