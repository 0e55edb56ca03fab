"""
Monitoring of a new model after it was taken into use.

A model is confirmed once it has predicted as many new samples as it was trained on. A model that
fails before that, while the previous model predicts the same samples well, is wrong.
"""

from __future__ import annotations

from collections import deque

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.live_nuisance import expected_residual
import numpy as np

# Number of slow samples that are evaluated together, three seconds at the default rate.
WINDOW = 15
# Residual in units of noise up to which a sample is predicted, and from which a window is not.
GOOD, BAD = 4.0, 6.0
# Largest ratio of the previous model's residual to that of the model in use for a rollback.
MAX_RATIO = 0.5
# Largest number of samples required to confirm a model.
MAX_REQUIRED = 200
# Minimum noise of a joint as a fraction of the largest.
_MIN_NOISE_FRACTION = 0.1


class ModelWatch:
    """
    Compares the model in use and the previous one on new slow samples.

    :param model: the model in use; one from a file (`learned` 0) counts as confirmed.
    :param before: the last model of the previous payload, None if there is none.
    :param learned: the number of training samples of the model.
    """

    def __init__(self, model: GravityModel, before: GravityModel | None, learned: int) -> None:
        self._before = before if before is not None and before.joints == model.joints else None
        noise = expected_residual(model)
        self._noise = np.maximum(noise, _MIN_NOISE_FRACTION * float(noise.max()) + 1e-9)
        self._required = min(learned, MAX_REQUIRED)
        self._predicted = 0
        self._errors: deque[FloatArray] = deque(maxlen=WINDOW)
        self._errors_before: deque[FloatArray] = deque(maxlen=WINDOW)

    @property
    def is_confirmed(self) -> bool:
        return self._predicted >= self._required

    def offer(self, q: FloatArray, tau: FloatArray, predicted: FloatArray) -> None:
        """Add a slow sample: pose, effort without effects and friction, predicted gravity."""
        error = np.abs(tau - predicted) / self._noise
        if not self.is_confirmed and float(error.max()) < GOOD:
            self._predicted += 1
        self._errors.append(error)
        if self._before is not None:
            self._errors_before.append(np.abs(tau - self._before.predict_one(q)) / self._noise)

    def objection(self) -> str | None:
        """Return why the previous model should come back, None if it should not."""
        if self.is_confirmed or self._before is None or len(self._errors) < WINDOW:
            return None
        new, old = (float(np.sqrt(np.square(errors).mean(axis=0)).max())
                    for errors in (self._errors, self._errors_before))
        if new < BAD or old > max(MAX_RATIO * new, GOOD):
            return None
        return (f'the residual of the model in use is {new:.0f} times its noise over {WINDOW} '
                f'new samples, that of the previous model {old:.0f} times')
