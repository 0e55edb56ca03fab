"""Broken effort, detected sample by sample: such samples are left out of all fits."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

OFF = 'effort_off'
FROZEN = 'effort_frozen'

# Smallest norm of the effort, as a fraction of the norm of the predicted torque.
_MIN_EFFORT = 0.1
# Ratio of predicted torque, or of its change, to noise above which it is significant.
_SIGNIFICANT = 10.0
# Motion of a joint, rad, within which the effort of some joint must change.
_MOVED = 0.05
# Ratio of the change of the predicted torque to noise above which constant effort of all joints
# is frozen. The steps of a coarse sensor are 3.5 times the noise that they cause.
_STEPPED = 5.0


class EffortHealth:
    """
    Detects drives that are off and frozen sensors.

    - Off: drives that are off, or a driver that subtracts gravity, report almost no effort on
      all joints although the model predicts gravity.
    - Frozen: all joints repeat the same numbers while the arm moves, or one joint does while the
      model predicts that its torque changes (frozen or saturated sensor).
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Drop the history: the clock, the payload or the model has changed."""
        # The joints whose effort is frozen, by number.
        self.frozen: tuple[int, ...] = ()
        # Pose, effort and prediction (N,) when any effort last changed.
        self._pose: FloatArray | None = None
        self._tau: FloatArray | None = None
        self._expected: FloatArray | None = None
        # Pose (N, N) and prediction (N,) when each joint's effort last changed.
        self._changed: tuple[FloatArray, FloatArray] | None = None

    def fault(self, q: FloatArray, tau: FloatArray, predicted: FloatArray | None,
              noise: FloatArray | None) -> str | None:
        """
        Return the fault of the effort of a slow sample, None if there is none.

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
        if size > _SIGNIFICANT * float(np.linalg.norm(noise)) and (
                float(np.linalg.norm(tau)) < _MIN_EFFORT * size):
            return OFF
        self.frozen = self._frozen_joints(q, repeats, predicted, noise)
        return FROZEN if self.frozen else None

    def _frozen_joints(self, q: FloatArray, repeats: np.ndarray, predicted: FloatArray,
                       noise: FloatArray) -> tuple[int, ...]:
        """Return the joints with constant effort while pose and predicted torque change."""
        if self._changed is None:
            self._changed = np.tile(q, (len(q), 1)), predicted.copy()
            return ()
        poses, torques = self._changed
        poses[~repeats], torques[~repeats] = q, predicted[~repeats]
        moved = np.abs(q - poses).max(axis=1) > _MOVED
        return tuple(np.flatnonzero(moved & (np.abs(predicted - torques) > _SIGNIFICANT * noise)))
