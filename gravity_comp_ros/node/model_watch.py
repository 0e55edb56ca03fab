"""
Whether the model in use goes on predicting what is measured, after it was taken.

A model is confirmed once it has predicted as many new samples as it was learned from. One that was
taken and does not get there, while the model before it predicts the same samples well, is wrong.
"""

from __future__ import annotations

from collections import deque

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.live_friction import usual_residual
import numpy as np

# Slow samples that are judged together: three seconds at the default rate.
WINDOW = 15
# In units of noise: up to this a sample is predicted, from this on a window is not.
GOOD, BAD = 4.0, 6.0
# The model before must leave less than this part of what the model in use leaves.
CLEARLY = 0.5
# No model needs more samples than this to be confirmed.
MOST_NEEDED = 200
# A joint's noise counts as this part of the largest one at least, N·m.
_LEAST_PART = 0.1


class ModelWatch:
    """
    Compares the model in use, and the one before, with slow samples as they come.

    :param model: the model in use; a known one (`learned` 0) counts as confirmed.
    :param before: the last model of the payload before, None if there is none.
    :param learned: how many samples the model was learned from.
    """

    def __init__(self, model: GravityModel, before: GravityModel | None, learned: int) -> None:
        self._before = before if before is not None and before.joints == model.joints else None
        noise = usual_residual(model)
        self._noise = np.maximum(noise, _LEAST_PART * float(noise.max()) + 1e-9)
        self._needed = min(learned, MOST_NEEDED)
        self._predicted = 0
        self._now: deque[FloatArray] = deque(maxlen=WINDOW)
        self._then: deque[FloatArray] = deque(maxlen=WINDOW)

    @property
    def is_confirmed(self) -> bool:
        return self._predicted >= self._needed

    def offer(self, q: FloatArray, tau: FloatArray, predicted: FloatArray) -> None:
        """Take in a healthy slow sample: pose, effort less effects and friction, prediction."""
        error = np.abs(tau - predicted) / self._noise
        if not self.is_confirmed and float(error.max()) < GOOD:
            self._predicted += 1
        self._now.append(error)
        if self._before is not None:
            self._then.append(np.abs(tau - self._before.predict_one(q)) / self._noise)

    def objection(self) -> str | None:
        """Return why the model before should come back, None if it should not."""
        if self.is_confirmed or self._before is None or len(self._now) < WINDOW:
            return None
        now, then = (float(np.sqrt(np.square(errors).mean(axis=0)).max())
                     for errors in (self._now, self._then))
        if now < BAD or then > max(CLEARLY * now, GOOD):
            return None
        return (f'the model in use leaves {now:.0f} times its noise over {WINDOW} samples that it '
                f'was not learned from, and the model before leaves {then:.0f}')
