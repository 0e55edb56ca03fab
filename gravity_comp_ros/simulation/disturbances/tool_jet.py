"""A force that turns with the tool, as the thrust of a water jet or the pull of a spindle."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
from numpy.typing import NDArray
import pinocchio as pin

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ToolJet:
    """
    A `force` in N on the last link, constant in its frame, at `point` in m in that frame.

    It acts on the arm; the drives hold against it.
    """

    force: tuple[float, float, float]
    point: tuple[float, float, float] = (0.0, 0.0, 0.1)

    def __post_init__(self) -> None:
        if not np.isfinite([*self.force, *self.point]).all():
            raise OptionError('tool jet: force and point must be finite')

    def torque(self, arm: Arm, q: FloatArray) -> FloatArray:
        """Return the drives' share (K, N) in N·m, from poses q (K, N) in rad."""
        moment = np.cross(self.point, self.force)
        wrench = np.concatenate([self.force, moment])
        data, last = arm.model.createData(), arm.model.njoints - 1
        zero, out = pin.neutral(arm.model), np.empty_like(q)
        for k, pose in enumerate(q):
            configuration = pin.integrate(arm.model, zero, pose)
            out[k] = -pin.computeJointJacobian(arm.model, data, configuration, last).T @ wrench
        return out

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        return replace(signals, tau=signals.tau + self.torque(arm, motion.q))
