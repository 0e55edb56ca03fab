"""Delay of slow samples until their acceleration follows from velocities before and after them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from gravity_comp_ros.data.acceleration import AccelerationOptions, RecentVelocity
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.node.messages import CompleteReading


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
