"""Samples on their way from a message to a fit: the torque published before, and acceleration."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from dataclasses import dataclass

from gravity_comp_ros.data.acceleration import AccelerationOptions, RecentVelocity
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.node.messages import CompleteReading
import numpy as np

# Possible delays of a driver from command to reported effort, s.
DELAYS = (0.0, 0.004, 0.01, 0.02, 0.05, 0.1, 0.2)
# Maximum number of torques kept; at least half of them, enough for the longest delay at 2 kHz.
_MAX_TORQUES = 2000


@dataclass(frozen=True, eq=False)
class Rows:
    """
    The samples (M) of an epoch in order of time, with one run for each start of the clock.

    `held_out` (M,) marks those that no fit uses. `sent` (M, D, N) is the torque in N·m that was
    published before each, for `DELAYS`, NaN where there was none; None without such torques.
    """

    samples: JointSamples
    held_out: BoolArray
    sent: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def train(self) -> JointSamples:
        """The samples to fit."""
        return self.samples.select(~self.held_out)

    def select(self, keep: BoolArray) -> Rows:
        """Return the rows that a mask (M,) keeps."""
        return Rows(self.samples.select(keep), self.held_out[keep],
                    None if self.sent is None else self.sent[keep])


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


@dataclass(eq=False)
class SlowSample:
    """
    A reading that passed the gate, and the torque published before it (`SentTorqueHistory`).

    `qdd` (N,) is its acceleration in rad/s^2, None if the message rate does not resolve it.
    """

    reading: CompleteReading
    sent: FloatArray
    qdd: FloatArray | None = None


class DelayedSamples:
    """
    Slow samples that wait for half a window of later messages.

    An acceleration from earlier messages alone would be that of a moment before the sample.
    """

    def __init__(self, options: AccelerationOptions = AccelerationOptions()) -> None:
        self._delay = 0.5 * options.window
        self._velocity = RecentVelocity(options)
        self._waiting: deque[SlowSample] = deque()

    def restart(self) -> None:
        """Drop all samples: the clock or the payload has changed."""
        self._velocity.restart()
        self._waiting.clear()

    def add_velocity(self, t: float, qd: FloatArray) -> None:
        """Add the velocity (N,) in rad/s of a message at time t in s, slow or not."""
        self._velocity.add(t, qd)

    def hold(self, reading: CompleteReading, sent: FloatArray) -> None:
        """Keep a slow sample."""
        self._waiting.append(SlowSample(reading, sent))

    def due(self, t: float) -> list[SlowSample]:
        """Return the samples that are old enough at time t in s, with their accelerations."""
        ready = []
        while self._waiting and t >= self._waiting[0].reading.t + self._delay:
            sample = self._waiting.popleft()
            sample.qdd = self._velocity.acceleration(sample.reading.t)
            ready.append(sample)
        return ready
