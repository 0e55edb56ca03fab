"""A spring balancer: a coil spring between the link and a point on the base."""

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
class SpringBalancer:
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

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        return with_torque(signals, self.joint, self.torque(motion.q[:, self.joint]))
