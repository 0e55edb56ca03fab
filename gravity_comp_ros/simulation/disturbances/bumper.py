"""A rubber bumper before the end of a joint's range."""

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
class Bumper:
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

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        torque = self.torque(motion.q[:, self.joint], motion.qd[:, self.joint])
        return with_torque(signals, self.joint, torque)
