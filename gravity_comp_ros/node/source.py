"""Where the feed-forward takes its torque from: a model, its range, and the model before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

Predict = Callable[[FloatArray], FloatArray]
TURN = 2.0 * math.pi


@dataclass(frozen=True, eq=False)
class Source:
    """
    A model as the feed-forward needs it: predict (N,) → (N,), and its trained range (N,).

    `reach` in rad bounds `extrapolation_margin` for a model that must not be used further out.
    `before` is the model of the payload before where only a share of the change is used
    (`unsure_change`).
    """

    predict: Predict
    q_min: FloatArray
    q_max: FloatArray
    reach: float = math.inf
    before: Predict | None = None

    def nearest(self, q: FloatArray) -> FloatArray:
        """
        Return pose q (N,) with whole turns taken off joints that are outside the trained range.

        Gravity has a period of one turn, so that the torque is the same. Within the range `q`
        itself is returned.
        """
        outside = (q < self.q_min) | (q > self.q_max)
        if not outside.any():
            return q
        middle = 0.5 * (self.q_min + self.q_max)
        return np.where(outside, q - TURN * np.round((q - middle) / TURN), q)

    def with_share(self, share: FloatArray) -> Predict:
        """Return the torque of `before` and a share (N,) of its change; all of it without one."""
        before = self.before
        if before is None:
            return self.predict

        def predict(q: FloatArray) -> FloatArray:
            old = before(q)
            return old + share * (self.predict(q) - old)
        return predict
