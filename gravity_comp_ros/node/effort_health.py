"""Effort that cannot be what the drives supply, sample by sample: nothing is learned from it."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

OFF = 'effort_off'
FROZEN = 'effort_frozen'

# The part of the gravity of the arm below which its effort is none, over all joints.
_NO_GRAVITY = 0.1
# Gravity of the arm counts where it is so many times the noise of its model.
_LOADED = 10.0
# While a joint moves over this, rad, some effort of the arm changes.
_MOVED = 0.05


class EffortHealth:
    """
    Looks at effort as it comes.

    Drives that are off, or a driver that takes gravity off, report next to nothing on all joints
    while the model says that the arm is heavy. A frozen driver repeats itself to the last digit
    while the arm moves.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget what came: the clock or the payload is another."""
        self._pose: FloatArray | None = None
        self._tau: FloatArray | None = None

    def fault(self, q: FloatArray, tau: FloatArray, predicted: FloatArray | None,
              noise: FloatArray | None) -> str | None:
        """
        Return why the effort of a slow sample is not to be learned from, None if it is.

        :param predicted: torque of the model in use (N,), `noise` (N,) its residual, N·m.
        """
        if self._pose is None or self._tau is None or not np.array_equal(tau, self._tau):
            self._pose, self._tau = q, tau
        elif float(np.abs(q - self._pose).max()) > _MOVED:
            return OFF if not tau.any() else FROZEN
        if predicted is None or noise is None:
            return None
        size = float(np.linalg.norm(predicted))
        if size > _LOADED * float(np.linalg.norm(noise)) and (
                float(np.linalg.norm(tau)) < _NO_GRAVITY * size):
            return OFF
        return None
