"""Disturbances that add a torque to one joint: springs, cables, stops, detents and cogging."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


class JointTorque(ABC):
    """A torque that is added to that of joint number `joint`, counted from 0."""

    joint: int

    @abstractmethod
    def added(self, signals: Signals, motion: Motion) -> FloatArray:
        """Return the torque that is added, (M,) in N·m."""

    def apply(self, signals: Signals, motion: Motion, arm: Arm) -> Signals:
        tau = signals.tau.copy()
        tau[:, self.joint] += self.added(signals, motion)
        return replace(signals, tau=tau)


class AngleTorque(JointTorque):
    """A torque that is a function of the angle alone."""

    @abstractmethod
    def torque(self, q: FloatArray) -> FloatArray:
        """Return the drive's torque (K,) in N·m at angles q (K,) in rad."""

    def added(self, signals: Signals, motion: Motion) -> FloatArray:
        return self.torque(motion.q[:, self.joint])


@dataclass(frozen=True)
class SpringBalancer(AngleTorque):
    """
    A spring from the link, `crank` m from the joint's axis, to the base, `post` m from it.

    Its length follows from the law of cosines, l^2 = crank^2 + post^2 - 2 crank post
    cos(q - rest); it is shortest at q = `rest` in rad. The force is `rate` N/m beyond the `free`
    length in m, and 0 below it (an unhooked coil spring).

    The torque of a spring of free length 0 is a sine of the angle, collinear with gravity.
    """

    joint: int
    rate: float
    free: float
    crank: float = 0.1
    post: float = 0.25
    rest: float = 0.0

    def length(self, q: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(self.crank ** 2 + self.post ** 2 - 2 * self.crank * self.post
                                  * np.cos(q - self.rest)))

    def torque(self, q: FloatArray) -> FloatArray:
        """Return the drive's torque (K,) in N·m: force times lever arm."""
        length = self.length(q)
        lever = self.crank * self.post * np.sin(q - self.rest) / length
        return np.asarray(self.rate * np.maximum(length - self.free, 0.0) * lever)


@dataclass(frozen=True)
class Detent(AngleTorque):
    """
    A potential well E(q) = -depth exp(-((q - centre) / width)^2 / 2).

    `centre` and `width` in rad. The drive's torque is dE/dq, at most `peak` N·m, one width from
    the centre.
    """

    joint: int
    centre: float
    peak: float
    width: float = 0.06

    def torque(self, q: FloatArray) -> FloatArray:
        x = (q - self.centre) / self.width
        return np.asarray(self.peak * x * np.exp(0.5 - x ** 2 / 2))


@dataclass(frozen=True)
class DressPack(AngleTorque):
    """
    A cable pack that is taut beyond the angle `slack` on one `side` (+1 or -1).

    With the stretch s = max(side (q - slack), 0) in rad the torque is

        stiffness * hardening * (exp(s / hardening) - 1):

    `stiffness` N·m/rad at s = 0, and e times that at s = `hardening` rad.
    """

    joint: int
    slack: float
    stiffness: float
    hardening: float = 3.0
    side: int = 1

    def torque(self, q: FloatArray) -> FloatArray:
        stretch, h = np.maximum(self.side * (q - self.slack), 0.0), self.hardening
        return np.asarray(self.side * self.stiffness * h * np.expm1(stretch / h))


@dataclass(frozen=True)
class Cogging(AngleTorque):
    """
    Periodic pulses, `teeth` per revolution of the joint, with a peak of `peak` N·m.

    Each pulse is exp((cos x - 1) / sharpness) with x = teeth (q - phase): round for a
    sharpness of 1 and more, narrow below. The mean is subtracted, so that a revolution takes no
    energy.
    """

    joint: int
    teeth: int
    peak: float
    sharpness: float = 0.5
    phase: float = 0.0

    def torque(self, q: FloatArray) -> FloatArray:
        angle = 2 * np.pi * np.arange(720) / 720
        mean = float(np.exp((np.cos(angle) - 1) / self.sharpness).mean())
        pulses = np.exp((np.cos(self.teeth * (q - self.phase)) - 1) / self.sharpness)
        return np.asarray(self.peak * (pulses - mean) / (1 - mean))


@dataclass(frozen=True)
class Bumper(JointTorque):
    """
    A Hunt-Crossley contact beyond the angle `at` in rad, on the side +1 or -1.

    With the depth x in rad the torque is stiffness x^exponent (1 + 3/2 loss dx/dt), never
    attractive. (K. H. Hunt, F. R. E. Crossley, "Coefficient of restitution interpreted as damping
    in vibroimpact", J. Applied Mechanics 42, 1975.)
    """

    joint: int
    at: float
    stiffness: float
    side: int = 1
    exponent: float = 1.2
    loss: float = 0.5

    def torque(self, q: FloatArray, qd: FloatArray) -> FloatArray:
        """Return the drive's torque (K,) in N·m."""
        depth = np.maximum(self.side * (q - self.at), 0.0)
        push = self.stiffness * depth ** self.exponent * (1 + 1.5 * self.loss * self.side * qd)
        return np.asarray(self.side * np.maximum(push, 0.0))

    def added(self, signals: Signals, motion: Motion) -> FloatArray:
        return self.torque(motion.q[:, self.joint], motion.qd[:, self.joint])
