"""The torque that the node published before each sample."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

# Possible delays of a driver from command to reported effort, s.
DELAYS = (0.0, 0.004, 0.01, 0.02, 0.05, 0.1, 0.2)
# Maximum number of torques kept; at least half of them, enough for the longest delay at 2 kHz.
_MAX_TORQUES = 2000


class SentTorqueHistory:
    """The recently published torques."""

    def __init__(self, n_joints: int) -> None:
        self._times: list[float] = []
        self._torques: list[FloatArray] = []
        self._none = np.full(n_joints, np.nan)

    def published(self, now: float, tau: FloatArray) -> None:
        """Record a published torque (N,)."""
        times, torques = self._times, self._torques
        if times and now < times[-1]:
            times.clear()
            torques.clear()
        elif len(times) >= _MAX_TORQUES:
            del times[:_MAX_TORQUES // 2], torques[:_MAX_TORQUES // 2]
        times.append(now)
        torques.append(tau)

    def before(self, now: float) -> FloatArray:
        """
        Return the last torque published before now minus each of `DELAYS` (D, N); NaN for none.

        The torque published at `now` is the response to the sample and is not included.
        """
        places = [bisect_left(self._times, now - delay) - 1 for delay in DELAYS]
        return np.array([self._torques[k] if k >= 0 else self._none for k in places])


@dataclass(frozen=True, eq=False)
class SentTorque:
    """The published torque of the samples of a job, (M, D, N) each, NaN where there was none."""

    train: FloatArray
    held_out: FloatArray
