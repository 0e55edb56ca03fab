"""
A greased gear: friction that grows with the logarithm of the speed.

Grease that is sheared at the rate v has the shear stress s asinh(v / v_0) (H. Eyring, Viscosity,
plasticity, and diffusion as examples of absolute reaction rates, J. Chem. Phys. 4, 1936): slow
grease is viscous, fast grease gets thinner.
"""

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
class GreasedGear:
    """
    Grease in the gear of a joint, counted from 0, beside its dry `surfaces`.

    Its torque is `stress` asinh(v / `thinning`), in N·m and rad/s.

    :raises OptionError: if a number is not positive.
    """

    joint: int
    stress: float
    thinning: float
    surfaces: LuGre

    def __post_init__(self) -> None:
        if not (self.stress > 0.0 and self.thinning > 0.0):
            raise OptionError('greased gear: stress and thinning speed must be positive')

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        grid = fine(motion)
        v = grid.qd[:, self.joint]
        dry = friction_torque(grid.t, grid.q[:, self.joint], v, self.surfaces)
        grease = self.stress * np.arcsinh(v / self.thinning)
        return with_torque(signals, self.joint, (dry + grease)[grid.at])
