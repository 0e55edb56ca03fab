"""Friction in the gear that two wrist joints share."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.disturbances.changed import check_joint
from gravity_comp_ros.simulation.disturbances.grid import fine
from gravity_comp_ros.simulation.disturbances.lugre import friction_torque, LuGre
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


@dataclass(frozen=True)
class DifferentialFriction:
    """
    LuGre friction on the two shafts of a differential that drives a pair of joints.

    The shafts turn by s = q_a + q_b and d = q_b - q_a. What rubs on them reaches the joints
    by the transpose of that map: tau_a = f_s - f_d, tau_b = f_s + f_d. A shaft without
    friction has None.
    """

    pair: tuple[int, int]
    sum_shaft: LuGre | None
    difference_shaft: LuGre | None = None

    def __post_init__(self) -> None:
        if self.pair[0] == self.pair[1]:
            raise OptionError('differential friction: the pair must be two joints')

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        a, b = self.pair
        check_joint(a, arm)
        check_joint(b, arm)
        grid, tau = fine(motion), signals.tau.copy()
        for sign, surfaces in ((1.0, self.sum_shaft), (-1.0, self.difference_shaft)):
            if surfaces is None:
                continue
            angle = grid.q[:, b] + sign * grid.q[:, a]
            speed = grid.qd[:, b] + sign * grid.qd[:, a]
            torque = friction_torque(grid.t, angle, speed, surfaces)[grid.at]
            tau[:, a] += sign * torque
            tau[:, b] += torque
        return replace(signals, tau=tau)
