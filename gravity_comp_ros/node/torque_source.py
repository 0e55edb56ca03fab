"""Torque source of the feed-forward: a model, its trained range, and the previous model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

Predict = Callable[[FloatArray], FloatArray]
REVOLUTION = 2.0 * math.pi


@dataclass(frozen=True, eq=False)
class TorqueSource:
    """
    A model for the feed-forward: predict (N,) → (N,), and its trained range (N,).

    `reach` in rad bounds `extrapolation_margin` for a model that extrapolates badly. `before` is
    the model of the previous payload where only a share of the change is used
    (`uncertain_change`).
    """

    predict: Predict
    q_min: FloatArray
    q_max: FloatArray
    reach: float = math.inf
    before: Predict | None = None

    def nearest(self, q: FloatArray) -> FloatArray:
        """
        Return pose q (N,) with whole revolutions subtracted from joints outside the trained range.

        Gravity has a period of one revolution, so the torque is the same. Within the range `q`
        itself is returned.
        """
        outside = (q < self.q_min) | (q > self.q_max)
        if not outside.any():
            return q
        middle = 0.5 * (self.q_min + self.q_max)
        return np.where(outside, q - REVOLUTION * np.round((q - middle) / REVOLUTION), q)

    def with_share(self, share: FloatArray) -> Predict:
        """Return the torque of `before` plus a share (N,) of its change; else `predict`."""
        before = self.before
        if before is None:
            return self.predict

        def predict(q: FloatArray) -> FloatArray:
            old = before(q)
            return old + share * (self.predict(q) - old)
        return predict
