"""Gear between the motor's encoder and the link: elasticity and backlash."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.disturbances.joint_torque import check_joint
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


class Gear(ABC):
    """A gear whose reported (motor) angle is ahead of that of the link of joint `joint`."""

    joint: int

    @abstractmethod
    def lead(self, t: FloatArray, load: FloatArray) -> FloatArray:
        """Return the lead of the motor's angle over the link's, (K,) in rad."""

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
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

    def __post_init__(self) -> None:
        if not (self.play > 0 and self.threshold >= 0 and self.crossing > 0):
            raise OptionError('backlash: play and crossing must be positive, threshold 0 or more')

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
    """
    A gear of `stiffness` N·m/rad: the motor's (reported) angle is q + tau / stiffness.

    With `hardening` in (N·m)^-2 the stiffness grows with load, as in harmonic drives: the wind-up
    is tau / (stiffness (1 + hardening tau^2)^(1/2)).
    """

    joint: int
    stiffness: float
    hardening: float = 0.0

    def __post_init__(self) -> None:
        if not self.stiffness > 0 or not self.hardening >= 0:
            raise OptionError(f'elastic gear: stiffness {self.stiffness} N·m/rad must be positive '
                              f'and hardening {self.hardening} 0 or more')

    def lead(self, t: FloatArray, load: FloatArray) -> FloatArray:
        return np.asarray(load / (self.stiffness * np.sqrt(1 + self.hardening * load ** 2)))
