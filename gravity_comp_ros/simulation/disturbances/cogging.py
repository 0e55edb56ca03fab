"""Cogging: a pulse of torque for every tooth that passes."""

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
class Cogging:
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

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        return with_torque(signals, self.joint, self.torque(motion.q[:, self.joint]))
