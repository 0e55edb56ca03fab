"""A narrow well of energy near one angle: a detent, a dent in a race, a magnet."""

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
class Detent:
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

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        return with_torque(signals, self.joint, self.torque(motion.q[:, self.joint]))
