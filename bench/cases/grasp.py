"""Payload that is grasped during a motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.simulation.arms import Arm, inverse_dynamics, Payload, with_payload
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


@dataclass(frozen=True)
class Grasp:
    """A payload that is attached from `after` s after the start of the motion."""

    payload: Payload
    after: float = 0.0

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        loaded = motion.t - motion.t[0] >= self.after
        q, qd, qdd = motion.q[loaded], motion.qd[loaded], motion.qdd[loaded]
        tau = signals.tau.copy()
        if loaded.any():
            tau[loaded] += (inverse_dynamics(with_payload(arm, self.payload), q, qd, qdd)
                            - inverse_dynamics(arm, q, qd, qdd))
        return replace(signals, tau=tau)
