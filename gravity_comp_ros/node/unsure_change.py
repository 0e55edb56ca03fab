"""
How much of a change that was learned from few samples is used at a pose.

A few seconds of motion may show what a payload does to some joints and hardly what it does
elsewhere. With d_n the change of the torque of joint n at a pose and s_n its standard deviation,

    share_n = max(0, 1 - (k s_n / d_n)^2),    k = 2 (1 + distance / 0.5 rad),

so that torque is old + share (new - old): a change that is not significant is not sent, one that
is certain is sent as it is. `distance` is how far the pose is outside the range of the new
samples: there the standard deviation itself is less certain.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

SIGNIFICANT = 2.0
REACH = 0.5
_SMALL = 1e-9


class UnsureChange:
    """
    The share of a change at any pose.

    :param model: learned from few samples. :param before: of the payload before.
    :param low: least angle of each joint in the new samples (N,), rad. :param high: largest.
    """

    def __init__(self, model: GravityModel, before: GravityModel, low: FloatArray,
                 high: FloatArray) -> None:
        self._model, self.before = model, before
        self._low, self._high = low, high

    def share(self, q: FloatArray) -> FloatArray:
        """Return which share (N,) of the change is used at pose q (N,), 0 to 1."""
        try:
            std = self._model.predict_std(q)[0]
        except (DataError, np.linalg.LinAlgError):
            return np.ones(len(q))
        change = self._model.predict_one(q) - self.before.predict_one(q)
        outside = float(np.maximum(np.maximum(self._low - q, q - self._high), 0.0).max())
        unsure = SIGNIFICANT * (1.0 + outside / REACH) * std
        return np.maximum(0.0, 1.0 - (unsure / np.maximum(np.abs(change), _SMALL)) ** 2)
