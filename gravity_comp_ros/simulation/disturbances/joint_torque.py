"""Base class of disturbances that add a torque to one joint."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


def check_joint(joint: int, arm: Arm) -> None:
    """
    Check the number of a joint, counted from 0.

    :raises OptionError: if the arm has no such joint.
    """
    if not 0 <= joint < arm.n_joints:
        raise OptionError(f'no joint number {joint + 1}: {arm.name} has {arm.n_joints}')


class JointTorque(ABC):
    """A torque that is added to that of joint number `joint`, counted from 0."""

    joint: int

    @abstractmethod
    def added(self, signals: Signals, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """Return the torque that is added, (M,) in N·m."""

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        tau = signals.tau.copy()
        tau[:, self.joint] += self.added(signals, motion, rng)
        return replace(signals, tau=tau)
