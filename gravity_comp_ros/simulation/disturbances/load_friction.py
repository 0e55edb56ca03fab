"""Friction that grows with the load that a gear carries."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.disturbances.changed import check_joint, with_torque
from gravity_comp_ros.simulation.disturbances.grid import fine
from gravity_comp_ros.simulation.disturbances.lugre import friction_torque, LuGre
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


@dataclass(frozen=True)
class LoadFriction:
    """
    LuGre friction whose sliding level is that of teeth pressed together.

    The preload that keeps the teeth engaged stands at right angles to the force that they
    transmit, so that the normal force is their hypotenuse and

        level = fraction * sqrt(preload^2 + load^2):

    the transmitted torque `load`, in N·m, loses the `fraction` once it is well above `preload`.
    """

    joint: int
    fraction: float
    preload: float = 3.0
    presliding: float = 2e-4

    def __post_init__(self) -> None:
        if not 0 < self.fraction < 1 or not self.preload > 0:
            raise OptionError(f'load friction: the fraction {self.fraction} must lie between 0 '
                              f'and 1 and the preload {self.preload} N·m above 0')

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        grid = fine(motion)
        load = grid.between_samples(signals.tau[:, self.joint])
        normal = np.hypot(self.preload, load)
        surfaces = LuGre(self.fraction, presliding=self.presliding)
        torque = friction_torque(grid.t, grid.q[:, self.joint], grid.qd[:, self.joint],
                                 surfaces, normal=normal)
        return with_torque(signals, self.joint, torque[grid.at])
