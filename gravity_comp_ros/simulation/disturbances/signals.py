"""Sensor faults, gears between motor and link, and disturbances of the whole arm."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.simulation.arms import Arm, gravity_torque, with_base_tilt
from gravity_comp_ros.simulation.disturbances.joint_torque import JointTorque
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
import pinocchio as pin


@dataclass(frozen=True)
class GaugeOffset(JointTorque):
    """A torque sensor with an offset of `offset` N·m."""

    joint: int
    offset: float

    def added(self, signals: Signals, motion: Motion) -> FloatArray:
        return np.full(len(motion.t), self.offset)


@dataclass(frozen=True)
class GaugeGain(JointTorque):
    """A torque sensor that reads `gain` times the torque."""

    joint: int
    gain: float

    def added(self, signals: Signals, motion: Motion) -> FloatArray:
        return (self.gain - 1.0) * signals.tau[:, self.joint]


@dataclass(frozen=True)
class GaugeDrift(JointTorque):
    """
    Drift of a torque sensor with its temperature.

    The mount warms as 1 - exp(-t / warming); the sensor follows with a time constant of `lag`
    times `warming`. Its offset rises by `rise` N·m with its temperature. The sensor was switched
    on `begun` s before the run.
    """

    joint: int
    rise: float
    warming: float = 200.0
    begun: float = 0.0
    lag: float = 0.0

    def temperature(self, age: FloatArray) -> FloatArray:
        """Return the temperature rise `age` s after switching on, relative to the final one."""
        mount, sensor = np.exp(-age / self.warming), np.zeros_like(age)
        if self.lag:
            sensor = np.exp(-age / (self.lag * self.warming))
        return np.asarray(1.0 - (mount - self.lag * sensor) / (1.0 - self.lag))

    def added(self, signals: Signals, motion: Motion) -> FloatArray:
        return self.rise * self.temperature(motion.t - motion.t[0] + self.begun)


@dataclass(frozen=True)
class EncoderOffset:
    """
    A joint whose reported angle is `offset` rad too large.

    An offset that is the same in all recordings is not identifiable: a sum of products of sines
    and cosines of shifted angles is another such sum.
    """

    joint: int
    offset: float

    def apply(self, signals: Signals, motion: Motion, arm: Arm) -> Signals:
        q = signals.q.copy()
        q[:, self.joint] += self.offset
        return replace(signals, q=q)


@dataclass(frozen=True)
class DelayedEffort:
    """
    Effort delayed by `delay` s.

    It is interpolated linearly between samples, which must resolve the torque. Before the first
    sample the torque is that of the first.
    """

    delay: float

    def apply(self, signals: Signals, motion: Motion, arm: Arm) -> Signals:
        return replace(signals, tau=np.stack([
            np.interp(motion.t - self.delay, motion.t, tau) for tau in signals.tau.T], axis=1))


class Gear(ABC):
    """A gear whose reported (motor) angle is ahead of that of the link of joint `joint`."""

    joint: int

    @abstractmethod
    def lead(self, t: FloatArray, load: FloatArray) -> FloatArray:
        """Return the lead of the motor's angle over the link's, (K,) in rad."""

    def apply(self, signals: Signals, motion: Motion, arm: Arm) -> Signals:
        lead = self.lead(motion.t, signals.tau[:, self.joint])
        q, qd = signals.q.copy(), signals.qd.copy()
        q[:, self.joint] += lead
        if len(lead) > 1:
            qd[:, self.joint] += np.gradient(lead, motion.t)
        return replace(signals, q=q, qd=qd)


@dataclass(frozen=True)
class Backlash(Gear):
    """
    A gear with `play` rad between its two flanks.

    The load determines the flank in contact. Contact changes to the other flank when the load
    exceeds `threshold` N·m in that direction, and takes `crossing` s. The motor's (reported) angle
    leads the link's by half the play at positive load, and lags by half at negative load.
    """

    joint: int
    play: float
    threshold: float = 0.5
    crossing: float = 0.05

    def lead(self, t: FloatArray, load: FloatArray) -> FloatArray:
        side = 1.0 if load[0] >= 0 else -1.0
        position, out = side, [side]
        for torque, step in zip(load[1:].tolist(), np.diff(t).tolist()):
            if abs(torque) > self.threshold:
                side = 1.0 if torque > 0 else -1.0
            largest = 2 * step / self.crossing
            position += min(max(side - position, -largest), largest)
            out.append(position)
        return 0.5 * self.play * np.array(out)


@dataclass(frozen=True)
class ElasticGear(Gear):
    """A gear of `stiffness` N·m/rad: the motor's (reported) angle is q + tau / stiffness."""

    joint: int
    stiffness: float

    def lead(self, t: FloatArray, load: FloatArray) -> FloatArray:
        return load / self.stiffness


@dataclass(frozen=True)
class TiltedBase:
    """A base rotated by `roll` about x, then by `pitch` about y, in rad."""

    roll: float
    pitch: float

    def apply(self, signals: Signals, motion: Motion, arm: Arm) -> Signals:
        tilted = with_base_tilt(arm, self.roll, self.pitch)
        change = gravity_torque(tilted, motion.q) - gravity_torque(arm, motion.q)
        return replace(signals, tau=signals.tau + change)


@dataclass(frozen=True)
class ToolForce:
    """
    A `force` in N on the last link, constant in its frame, at `point` in m in that frame.

    The drives compensate it.
    """

    force: tuple[float, float, float]
    point: tuple[float, float, float] = (0.0, 0.0, 0.1)

    def torque(self, arm: Arm, q: FloatArray) -> FloatArray:
        """Return the drives' torque (K, N) in N·m at poses q (K, N) in rad."""
        moment = np.cross(self.point, self.force)
        wrench = np.concatenate([self.force, moment])
        data, last = arm.model.createData(), arm.model.njoints - 1
        zero, out = pin.neutral(arm.model), np.empty_like(q)
        for k, pose in enumerate(q):
            configuration = pin.integrate(arm.model, zero, pose)
            out[k] = -pin.computeJointJacobian(arm.model, data, configuration, last).T @ wrench
        return out

    def apply(self, signals: Signals, motion: Motion, arm: Arm) -> Signals:
        return replace(signals, tau=signals.tau + self.torque(arm, motion.q))
