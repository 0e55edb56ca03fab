"""Sensor faults: offset, gain and drift of a torque sensor, encoder offset, delayed effort."""

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
class GaugeOffset(JointTorque):
    """A torque sensor with an offset of `offset` N·m."""

    joint: int
    offset: float

    def added(self, signals: Signals, motion: Motion, rng: np.random.Generator) -> FloatArray:
        return np.full(len(motion.t), self.offset)


@dataclass(frozen=True)
class GaugeGain(JointTorque):
    """A torque sensor that reads `gain` times the torque."""

    joint: int
    gain: float

    def added(self, signals: Signals, motion: Motion, rng: np.random.Generator) -> FloatArray:
        return (self.gain - 1.0) * signals.tau[:, self.joint]


@dataclass(frozen=True)
class GaugeDrift(JointTorque):
    """
    Drift of a torque sensor with its temperature, and a random walk.

    The mount warms as 1 - exp(-t / warming); the sensor follows with a time constant of `lag`
    times `warming`. Its offset rises by `rise` N·m with its temperature. The random walk has
    `wander` N·m per square root of a second. The sensor was switched on `begun` s before the run.
    """

    joint: int
    rise: float
    warming: float = 200.0
    wander: float = 0.0
    begun: float = 0.0
    lag: float = 0.0

    def __post_init__(self) -> None:
        if not self.warming > 0 or not self.wander >= 0 or not 0.0 <= self.lag < 1.0:
            raise OptionError(f'gauge drift: warming is {self.warming} s; it must be positive; '
                              f'wander is {self.wander}; it must be 0 or more; lag is '
                              f'{self.lag}; it must be 0 or more and less than 1')

    def temperature(self, age: FloatArray) -> FloatArray:
        """Return the temperature rise `age` s after switching on, relative to the final one."""
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
    A joint whose reported angle is `offset` rad too large.

    An offset that is the same in all recordings is not identifiable: a sum of products of sines
    and cosines of shifted angles is another such sum.
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
class DelayedEffort:
    """
    Effort delayed by `delay` s on every joint, or on `joints` only.

    It is interpolated linearly between samples, which must resolve the torque. Before the first
    sample the torque is that of the first.
    """

    delay: float
    joints: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        if not self.delay >= 0:
            raise OptionError(f'delayed effort: the delay is {self.delay} s; it must be 0 or more')

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        tau = signals.tau.copy()
        for joint in range(arm.n_joints) if self.joints is None else self.joints:
            tau[:, joint] = np.interp(motion.t - self.delay, motion.t, signals.tau[:, joint])
        return replace(signals, tau=tau)
