"""A torque sensor's own errors: its zero, its gain, and a zero that wanders."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.disturbances.changed import check_joint, with_torque
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


@dataclass(frozen=True)
class GaugeZero:
    """A bridge that is out of balance by `zero` N·m."""

    joint: int
    zero: float

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        return with_torque(signals, self.joint, np.full(len(motion.t), self.zero))


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
class GaugeDrift:
    """
    A zero that moves while the sensor warms, and wanders besides.

    The sensor's temperature rises from cold as 1 - exp(-t / warming), and the zero by `rise`
    N·m with it; a random walk of `wander` N·m per square root of a second is added to it. The
    sensor was switched on `begun` s before the run.
    """

    joint: int
    rise: float
    warming: float = 200.0
    wander: float = 0.0
    begun: float = 0.0

    def __post_init__(self) -> None:
        if not self.warming > 0 or not self.wander >= 0:
            raise OptionError(f'gauge drift: warming takes {self.warming} s, it must be positive, '
                              f'and wander is {self.wander}, it must be 0 or more')

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        age = motion.t - motion.t[0]
        steps = rng.standard_normal(len(age)) * np.sqrt(np.diff(age, prepend=0.0))
        walk = self.wander * np.cumsum(steps)
        return with_torque(signals, self.joint,
                           self.rise * -np.expm1(-(age + self.begun) / self.warming) + walk)
