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
# The torque of some joint must then change by so many times the noise of the model, where there is
# one: the steps of a coarse sensor are 3.5 times the noise that they make.
_STEPPED = 5.0


class EffortHealth:
    """
    Looks at effort as it comes.

    Drives that are off, or a driver that takes gravity off, report next to nothing on all joints
    while the model says that the arm is heavy. A frozen driver repeats itself to the last digit
    while the arm moves. So does one joint whose sensor is frozen or at the end of its range, while
    the model says that its torque changes.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget what came: the clock, the payload or the model is another."""
        # The joints whose effort is frozen, by number.
        self.frozen: tuple[int, ...] = ()
        # Pose, effort and prediction (N,) when any effort last changed.
        self._pose: FloatArray | None = None
        self._tau: FloatArray | None = None
        self._expected: FloatArray | None = None
        # The pose (N,) and the prediction (N,) when each joint's effort last changed.
        self._changed: tuple[FloatArray, FloatArray] | None = None

    def fault(self, q: FloatArray, tau: FloatArray, predicted: FloatArray | None,
              noise: FloatArray | None) -> str | None:
        """
        Return why the effort of a slow sample is not to be learned from, None if it is.

        :param predicted: torque of the model in use (N,), `noise` (N,) its residual, N·m.
        """
        self.frozen = ()
        repeats = np.zeros(len(tau), dtype=bool) if self._tau is None else tau == self._tau
        if self._pose is None or not repeats.all():
            self._pose, self._tau, self._expected = q, tau, predicted
        elif float(np.abs(q - self._pose).max()) > _MOVED and (
                predicted is None or noise is None or self._expected is None
                or bool((np.abs(predicted - self._expected) > _STEPPED * noise).any())):
            if not tau.any():
                return OFF
            self.frozen = tuple(range(len(tau)))
            return FROZEN
        if predicted is None or noise is None:
            self._changed = None
            return None
        size = float(np.linalg.norm(predicted))
        if size > _LOADED * float(np.linalg.norm(noise)) and (
                float(np.linalg.norm(tau)) < _NO_GRAVITY * size):
            return OFF
        self.frozen = self._stuck(q, repeats, predicted, noise)
        return FROZEN if self.frozen else None

    def _stuck(self, q: FloatArray, repeats: np.ndarray, predicted: FloatArray,
               noise: FloatArray) -> tuple[int, ...]:
        """Return the joints that repeat their effort while their torque and the pose change."""
        if self._changed is None:
            self._changed = np.tile(q, (len(q), 1)), predicted.copy()
            return ()
        poses, torques = self._changed
        poses[~repeats], torques[~repeats] = q, predicted[~repeats]
        moved = np.abs(q - poses).max(axis=1) > _MOVED
        return tuple(np.flatnonzero(moved & (np.abs(predicted - torques) > _LOADED * noise)))
