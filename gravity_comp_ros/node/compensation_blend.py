"""Torque of compensated effects in addition to gravity, without steps."""

from __future__ import annotations

from collections.abc import Callable

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.data.short_vectors import all_finite
import numpy as np

# Torque of effects (N,) in N·m at a pose (N,) and a speed (N,); None without a speed.
Compensation = Callable[[FloatArray, FloatArray | None], FloatArray | None]
# Maximum number of compensations that are blended at a time; a later one waits for the end.
MAX_PARTS = 4


class CompensationBlend:
    """
    Blends a new compensation with the one before, and ramps where none is usable.

    Effects depend on the direction of motion, so both compensations are evaluated at the present
    speed. A gain multiplies the sum. It falls without usable input and rises with it.

    :param n_joints: the number N of joints.
    """

    def __init__(self, n_joints: int) -> None:
        self._zeros = np.zeros(n_joints)
        # Weights, which sum to 1, and compensations; the last weight rises.
        self._parts: list[tuple[float, Compensation | None]] = [(1.0, None)]
        # The one that waits, if any.
        self._waiting: tuple[Compensation | None, ...] = ()
        self._gain = 1.0
        self._last = self._zeros

    def use(self, compensation: Compensation | None) -> None:
        """Blend to another compensation; None for no torque."""
        if len(self._parts) == MAX_PARTS:
            self._waiting = (compensation,)
        elif compensation is not None or any(part for _, part in self._parts):
            self._parts.append((0.0, compensation))

    def restart(self) -> None:
        """Use the whole present compensation with the next input."""
        latest = self._waiting[0] if self._waiting else self._parts[-1][1]
        self._parts, self._waiting = [(1.0, latest)], ()
        self._gain, self._last = 1.0, self._zeros

    def torque(self, q: FloatArray, qd: FloatArray | None, step: float) -> FloatArray:
        """
        Return the torque (N,) in N·m at pose `q` (N,) and speed `qd` (N,).

        :param step: time since the last call as a fraction of the ramp time.
        """
        before = self._parts, self._waiting
        if len(self._parts) > 1:
            self._advance(step)
        torque = self._blended(q, qd)
        if torque is None or not all_finite(torque):
            # The blend continues from here with the next usable input.
            self._parts, self._waiting = before
            return self.fade(step)
        self._gain = min(1.0, self._gain + step)
        self._last = torque
        return self._gain * torque

    def fade(self, step: float) -> FloatArray:
        """Return the last torque (N,) in N·m on its ramp to zero; `step` as for `torque`."""
        self._gain = max(0.0, self._gain - step)
        return self._gain * self._last

    def _advance(self, step: float) -> None:
        old = self._parts[-1][0]
        new = min(1.0, old + step)
        if new == 1.0:
            self._parts = [(1.0, self._parts[-1][1]), *((0.0, part) for part in self._waiting)]
            self._waiting = ()
            return
        rest = (1.0 - new) / (1.0 - old)
        self._parts = [*((rest * weight, part) for weight, part in self._parts[:-1]),
                       (new, self._parts[-1][1])]

    def _blended(self, q: FloatArray, qd: FloatArray | None) -> FloatArray | None:
        total = self._zeros
        for weight, part in self._parts:
            if part is None:
                continue
            torque = part(q, qd)
            if torque is None:
                return None
            total = total + weight * torque
        return total
