"""A hose and cable pack that goes taut: slack at first, then stiffer and stiffer."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.disturbances.changed import check_joint, with_torque
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class DressPack:
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

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        return with_torque(signals, self.joint, self.torque(motion.q[:, self.joint]))
