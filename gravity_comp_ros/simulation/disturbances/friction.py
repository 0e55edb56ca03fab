"""Friction in one joint's gear, the same or not in both directions."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.disturbances.changed import check_joint, with_torque
from gravity_comp_ros.simulation.disturbances.grid import fine
from gravity_comp_ros.simulation.disturbances.lugre import friction_torque, LuGre
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


@dataclass(frozen=True)
class Friction:
    """
    LuGre friction on a joint, counted from 0; `backward` if it differs at negative speed.

    A long `presliding` distance makes it a hysteresis that reversals show.
    """

    joint: int
    surfaces: LuGre
    backward: LuGre | None = None

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        grid = fine(motion)
        torque = friction_torque(grid.t, grid.q[:, self.joint], grid.qd[:, self.joint],
                                 self.surfaces, self.backward)
        return with_torque(signals, self.joint, torque[grid.at])
