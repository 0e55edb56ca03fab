"""An effort that arrives later than the position that it belongs to."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


@dataclass(frozen=True)
class LateEffort:
    """
    Effort `delay` s late on every joint, or on `joints` alone.

    Between samples it runs in straight lines, so samples should lie closer than the torque
    turns. Before the first sample the arm is at rest, and the torque that of the first.
    """

    delay: float
    joints: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        if not self.delay >= 0:
            raise OptionError(f'late effort: the delay is {self.delay} s; it must be 0 or more')

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        tau = signals.tau.copy()
        for joint in range(arm.n_joints) if self.joints is None else self.joints:
            tau[:, joint] = np.interp(motion.t - self.delay, motion.t, signals.tau[:, joint])
        return replace(signals, tau=tau)
