"""Torques that follow from a joint's angle: springs, cables, stops, detents and teeth."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.disturbances.joint_torque import JointTorque
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


class AngleTorque(JointTorque):
    """A torque that the angle alone tells."""

    @abstractmethod
    def torque(self, q: FloatArray) -> FloatArray:
        """Return the drive's share (K,) in N·m at angles q (K,) in rad."""

    def added(self, signals: Signals, motion: Motion, rng: np.random.Generator) -> FloatArray:
        return self.torque(motion.q[:, self.joint])


@dataclass(frozen=True)
class SpringBalancer(AngleTorque):
    """
    A spring hooked `crank` m from the joint's axis on the link, and `post` m on the base.

    Its length follows from the law of cosines, l^2 = crank^2 + post^2 - 2 crank post
    cos(q - rest); it is shortest at q = `rest` in rad. It pulls with `rate` N/m beyond its
    `free` length in m, and not at all below: a coil spring's hook is loose then.

    A spring of free length 0 would pull with a sine of the angle, as gravity does, and could
    not be told from it.
    """

    joint: int
    rate: float
    free: float
    crank: float = 0.1
    post: float = 0.25
    rest: float = 0.0

    def __post_init__(self) -> None:
        if not (self.rate > 0 and self.free >= 0 and self.crank > 0 and self.post > self.crank):
            raise OptionError('spring balancer: rate and crank must be positive, the free length '
                              '0 or more, and the post longer than the crank')

    def length(self, q: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(self.crank ** 2 + self.post ** 2 - 2 * self.crank * self.post
                                  * np.cos(q - self.rest)))

    def energy(self, q: FloatArray) -> FloatArray:
        """Return what the spring holds (K,) in J."""
        return np.asarray(0.5 * self.rate * np.maximum(self.length(q) - self.free, 0.0) ** 2)

    def torque(self, q: FloatArray) -> FloatArray:
        """Return the drive's share (K,) in N·m: the pull times its lever arm."""
        length = self.length(q)
        lever = self.crank * self.post * np.sin(q - self.rest) / length
        return np.asarray(self.rate * np.maximum(length - self.free, 0.0) * lever)


@dataclass(frozen=True)
class Detent(AngleTorque):
    """
    A well E(q) = -depth exp(-((q - centre) / width)^2 / 2) in J; `centre`, `width` in rad.

    The drive pays dE/dq: at most `peak` N·m, one width from the centre.
    """

    joint: int
    centre: float
    peak: float
    width: float = 0.06

    def __post_init__(self) -> None:
        if not self.width > 0:
            raise OptionError(f'detent: its width is {self.width} rad; it must be positive')

    @property
    def depth(self) -> float:
        """Return the well's depth in J."""
        return self.peak * self.width * float(np.exp(0.5))

    def energy(self, q: FloatArray) -> FloatArray:
        x = (q - self.centre) / self.width
        return np.asarray(-self.depth * np.exp(-x ** 2 / 2))

    def torque(self, q: FloatArray) -> FloatArray:
        x = (q - self.centre) / self.width
        return np.asarray(self.depth / self.width * x * np.exp(-x ** 2 / 2))


@dataclass(frozen=True)
class DressPack(AngleTorque):
    """
    A pack that stretches beyond the angle `slack` on the side that `side` (+1 or -1) says.

    With the stretch s = max(side (q - slack), 0) in rad it pulls back by

        stiffness * hardening * (exp(s / hardening) - 1),

    `stiffness` N·m/rad where it goes taut, and e times that after `hardening` rad more.
    """

    joint: int
    slack: float
    stiffness: float
    hardening: float = 3.0
    side: int = 1

    def __post_init__(self) -> None:
        if not self.hardening > 0 or self.side not in (-1, 1):
            raise OptionError(f'dress pack: hardening is {self.hardening} rad, it must be '
                              f'positive, and side is {self.side}, it must be 1 or -1')

    def stretch(self, q: FloatArray) -> FloatArray:
        return np.asarray(np.maximum(self.side * (q - self.slack), 0.0))

    def energy(self, q: FloatArray) -> FloatArray:
        s, h = self.stretch(q), self.hardening
        return np.asarray(self.stiffness * h * (h * np.expm1(s / h) - s))

    def torque(self, q: FloatArray) -> FloatArray:
        h = self.hardening
        return np.asarray(self.side * self.stiffness * h * np.expm1(self.stretch(q) / h))


@dataclass(frozen=True)
class Cogging(AngleTorque):
    """
    A train of pulses, `teeth` in a turn of the joint, of `peak` N·m above their mean.

    Each pulse is exp((cos x - 1) / sharpness) with x = teeth (q - phase): round for a
    sharpness of 1 and more, narrow below. Their mean is taken away, so that a turn costs no
    energy.
    """

    joint: int
    teeth: int
    peak: float
    sharpness: float = 0.5
    phase: float = 0.0

    def __post_init__(self) -> None:
        if self.teeth < 1 or not self.sharpness > 0:
            raise OptionError(f'cogging: {self.teeth} teeth and sharpness {self.sharpness}; '
                              f'there must be a tooth, and some width')

    def torque(self, q: FloatArray) -> FloatArray:
        turn = 2 * np.pi * np.arange(720) / 720
        mean = float(np.exp((np.cos(turn) - 1) / self.sharpness).mean())
        pulses = np.exp((np.cos(self.teeth * (q - self.phase)) - 1) / self.sharpness)
        return np.asarray(self.peak * (pulses - mean) / (1 - mean))

    def amplitude(self) -> float:
        """Return the amplitude in N·m of the sine with one period a tooth."""
        q = 2 * np.pi / self.teeth * np.arange(720) / 720
        shape = self.torque(q + self.phase)
        return float(2 * (shape * np.cos(self.teeth * q)).mean())


@dataclass(frozen=True)
class Bumper(JointTorque):
    """
    A Hunt-Crossley contact beyond the angle `at` in rad, on the side +1 or -1.

    With the depth x in rad and its rate: stiffness x^exponent (1 + 3/2 loss dx/dt), never a
    pull. (K. H. Hunt, F. R. E. Crossley, "Coefficient of restitution interpreted as damping in
    vibroimpact", J. Applied Mechanics 42, 1975.)
    """

    joint: int
    at: float
    stiffness: float
    side: int = 1
    exponent: float = 1.2
    loss: float = 0.5

    def __post_init__(self) -> None:
        if self.side not in (-1, 1) or not (self.stiffness > 0 and self.exponent >= 1):
            raise OptionError('bumper: the side must be 1 or -1, the stiffness positive and the '
                              'exponent 1 or more')

    def torque(self, q: FloatArray, qd: FloatArray) -> FloatArray:
        """Return the drive's share (K,) in N·m."""
        depth = np.maximum(self.side * (q - self.at), 0.0)
        push = self.stiffness * depth ** self.exponent * (1 + 1.5 * self.loss * self.side * qd)
        return np.asarray(self.side * np.maximum(push, 0.0))

    def added(self, signals: Signals, motion: Motion, rng: np.random.Generator) -> FloatArray:
        return self.torque(motion.q[:, self.joint], motion.qd[:, self.joint])
