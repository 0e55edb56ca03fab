"""A gear that winds up under load, between the encoder at the motor and the link."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.disturbances.changed import check_joint
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


@dataclass(frozen=True)
class SoftGear:
    """
    A gear of `stiffness` N·m/rad: the motor's angle, the one reported, is q + tau / stiffness.

    `hardening` in (N·m)^-2 makes it stiffer with load, as harmonic drives are: the wind-up is
    then tau / (stiffness (1 + hardening tau^2)^(1/2)).
    """

    joint: int
    stiffness: float
    hardening: float = 0.0

    def __post_init__(self) -> None:
        if not self.stiffness > 0 or not self.hardening >= 0:
            raise OptionError(f'soft gear: stiffness {self.stiffness} N·m/rad must be positive '
                              f'and hardening {self.hardening} 0 or more')

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        load = signals.tau[:, self.joint]
        wound = load / (self.stiffness * np.sqrt(1 + self.hardening * load ** 2))
        q, qd = signals.q.copy(), signals.qd.copy()
        q[:, self.joint] += wound
        if len(motion.t) > 1:
            qd[:, self.joint] += np.gradient(wound, motion.t)
        return replace(signals, q=q, qd=qd)
