"""How a disturbance hands its signals on."""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def with_torque(signals: Signals, joint: int, torque: FloatArray) -> Signals:
    """Return the signals with `torque` (M,) in N·m more on one joint."""
    tau = signals.tau.copy()
    tau[:, joint] += torque
    return replace(signals, tau=tau)


def check_joint(joint: int, arm: Arm) -> None:
    """
    Check a joint's number, counted from 0.

    :raises OptionError: if the arm has no such joint.
    """
    if not 0 <= joint < arm.n_joints:
        raise OptionError(f'no joint number {joint + 1}: {arm.name} has {arm.n_joints}')
