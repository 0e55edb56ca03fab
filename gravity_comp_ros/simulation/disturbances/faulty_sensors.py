"""Sensors that err: a gauge's zero, gain and drift, an encoder's zero, an effort that is late."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.disturbances.joint_torque import check_joint, JointTorque
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


@dataclass(frozen=True)
class GaugeZero(JointTorque):
    """A bridge that is out of balance by `zero` N·m."""

    joint: int
    zero: float

    def added(self, signals: Signals, motion: Motion, rng: np.random.Generator) -> FloatArray:
        return np.full(len(motion.t), self.zero)


@dataclass(frozen=True)
class GaugeGain:
    """A gauge that reads `gain` times the torque."""

    joint: int
    gain: float

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        tau = signals.tau.copy()
        tau[:, self.joint] *= self.gain
        return replace(signals, tau=tau)


@dataclass(frozen=True)
class GaugeDrift(JointTorque):
    """
    A zero that moves while the sensor warms, and wanders besides.

    What the sensor is mounted on warms as 1 - exp(-t / warming), and the sensor follows with a
    time constant that is `lag` times as long. Its zero rises by `rise` N·m with its temperature;
    a random walk of `wander` N·m per square root of a second is added to it. The sensor was
    switched on `begun` s before the run.
    """

    joint: int
    rise: float
    warming: float = 200.0
    wander: float = 0.0
    begun: float = 0.0
    lag: float = 0.0

    def __post_init__(self) -> None:
        if not self.warming > 0 or not self.wander >= 0 or not 0.0 <= self.lag < 1.0:
            raise OptionError(f'gauge drift: warming takes {self.warming} s, it must be positive, '
                              f'wander is {self.wander}, it must be 0 or more, and lag is '
                              f'{self.lag}, it must be 0 or more and less than 1')

    def temperature(self, age: FloatArray) -> FloatArray:
        """Return how warm the sensor is `age` s after it was switched on, from 0 to 1."""
        mount, sensor = np.exp(-age / self.warming), np.zeros_like(age)
        if self.lag:
            sensor = np.exp(-age / (self.lag * self.warming))
        return np.asarray(1.0 - (mount - self.lag * sensor) / (1.0 - self.lag))

    def added(self, signals: Signals, motion: Motion, rng: np.random.Generator) -> FloatArray:
        age = motion.t - motion.t[0]
        steps = rng.standard_normal(len(age)) * np.sqrt(np.diff(age, prepend=0.0))
        walk = self.wander * np.cumsum(steps)
        return np.asarray(self.rise * self.temperature(age + self.begun) + walk)


@dataclass(frozen=True)
class EncoderOffset:
    """
    A joint that reports its angle `offset` rad too large.

    One that is there in every recording cannot be seen in them: turned by a constant angle, a
    sum of products of sines and cosines is another such sum.
    """

    joint: int
    offset: float

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        q = signals.q.copy()
        q[:, self.joint] += self.offset
        return replace(signals, q=q)


@dataclass(frozen=True)
class LateEffort:
    """
    Effort `delay` s late on every joint, or on `joints` alone.

    Between samples it runs in straight lines, so samples should lie closer than the torque
    turns. Before the first sample the arm is at rest, and the torque that of the first.
    """

    delay: float
    joints: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        if not self.delay >= 0:
            raise OptionError(f'late effort: the delay is {self.delay} s; it must be 0 or more')

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        tau = signals.tau.copy()
        for joint in range(arm.n_joints) if self.joints is None else self.joints:
            tau[:, joint] = np.interp(motion.t - self.delay, motion.t, signals.tau[:, joint])
        return replace(signals, tau=tau)
