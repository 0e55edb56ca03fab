"""
Share of a change that is used where few samples determine it.

A few seconds of motion may determine the change of some joints well and of others badly. With d_n
the change of the torque of joint n at a pose and s_n its standard deviation,

    share_n = max(0, 1 - (k s_n / d_n)^2),    k = 2 (1 + distance / 0.5 rad),

the torque is old + share (new - old). A change that is not significant is not sent. `distance` is
the distance of the pose outside the range of the new samples, where the standard deviation itself
is less certain.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

# Standard deviations of a significant change within the range of the samples.
SIGNIFICANT = 2.0
# Distance outside the range of the samples that doubles this number, rad.
REACH = 0.5
_MIN_CHANGE = 1e-9


class UncertainChange:
    """
    The share of a change at any pose.

    :param model: learned from few samples.
    :param before: model of the previous payload.
    :param low: smallest angle of each joint in the new samples (N,), rad; `high` the largest.
    """

    def __init__(self, model: GravityModel, before: GravityModel, low: FloatArray,
                 high: FloatArray) -> None:
        self._model, self.before = model, before
        self._low, self._high = low, high

    def share(self, q: FloatArray) -> FloatArray:
        """Return the share (N,) of the change to use at pose q (N,), 0 to 1."""
        try:
            std = self._model.predict_std(q)[0]
        except (DataError, np.linalg.LinAlgError):
            return np.ones(len(q))
        change = self._model.predict_one(q) - self.before.predict_one(q)
        outside = float(np.maximum(np.maximum(self._low - q, q - self._high), 0.0).max())
        uncertain = SIGNIFICANT * (1.0 + outside / REACH) * std
        return np.maximum(0.0, 1.0 - (uncertain / np.maximum(np.abs(change), _MIN_CHANGE)) ** 2)
