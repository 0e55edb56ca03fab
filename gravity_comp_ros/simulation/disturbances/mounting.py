"""The arm is bolted to a base that is not level."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.simulation.arms import Arm, gravity_torque, with_base_tilt
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


@dataclass(frozen=True)
class TiltedBase:
    """A base turned by `roll` about x, then by `pitch` about y, in rad."""

    roll: float
    pitch: float

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        tilted = with_base_tilt(arm, self.roll, self.pitch)
        change = gravity_torque(tilted, motion.q) - gravity_torque(arm, motion.q)
        return replace(signals, tau=signals.tau + change)
