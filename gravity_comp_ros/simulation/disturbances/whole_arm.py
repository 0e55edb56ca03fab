"""Disturbances of the whole arm: base tilt and tool force."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm, gravity_torque, with_base_tilt
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
import pinocchio as pin


@dataclass(frozen=True)
class TiltedBase:
    """A base rotated by `roll` about x, then by `pitch` about y, in rad."""

    roll: float
    pitch: float

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        tilted = with_base_tilt(arm, self.roll, self.pitch)
        change = gravity_torque(tilted, motion.q) - gravity_torque(arm, motion.q)
        return replace(signals, tau=signals.tau + change)


@dataclass(frozen=True)
class ToolForce:
    """
    A `force` in N on the last link, constant in its frame, at `point` in m in that frame.

    The drives compensate it.
    """

    force: tuple[float, float, float]
    point: tuple[float, float, float] = (0.0, 0.0, 0.1)

    def __post_init__(self) -> None:
        if not np.isfinite([*self.force, *self.point]).all():
            raise OptionError('tool force: force and point must be finite')

    def torque(self, arm: Arm, q: FloatArray) -> FloatArray:
        """Return the drives' torque (K, N) in N·m at poses q (K, N) in rad."""
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
