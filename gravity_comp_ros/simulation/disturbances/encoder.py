"""An encoder whose zero is off."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.disturbances.changed import check_joint
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


@dataclass(frozen=True)
class EncoderOffset:
    """
    A joint that reports its angle `offset` rad too large.

    One that is there in every recording cannot be seen in them: turned by a constant angle, a
    sum of products of sines and cosines is another such sum.
    """

    joint: int
    offset: float

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        q = signals.q.copy()
        q[:, self.joint] += self.offset
        return replace(signals, q=q)
