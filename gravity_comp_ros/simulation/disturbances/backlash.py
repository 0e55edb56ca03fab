"""Play between the teeth of a gear, with the encoder at the motor."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.disturbances.changed import check_joint
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


@dataclass(frozen=True)
class Backlash:
    """
    A link that lies on one flank or the other of a gear with `play` rad between them.

    The load presses it on a flank; it lets go once the load has turned by `grip` N·m, and is
    across after `crossing` s. The motor's angle, the one reported, leads the link's by half of
    the play on the flank that carries a positive load, and lags by half on the other.
    """

    joint: int
    play: float
    grip: float = 0.5
    crossing: float = 0.05

    def __post_init__(self) -> None:
        if not (self.play > 0 and self.grip >= 0 and self.crossing > 0):
            raise OptionError('backlash: play and crossing must be positive, grip 0 or more')

    def lead(self, t: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Return what the motor's angle leads the link's by, (K,) in rad."""
        side = 1.0 if load[0] >= 0 else -1.0
        place, out = side, [side]
        for torque, step in zip(load[1:].tolist(), np.diff(t).tolist()):
            if abs(torque) > self.grip:
                side = 1.0 if torque > 0 else -1.0
            far = 2 * step / self.crossing
            place += min(max(side - place, -far), far)
            out.append(place)
        return 0.5 * self.play * np.array(out)

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        lead = self.lead(motion.t, signals.tau[:, self.joint])
        q, qd = signals.q.copy(), signals.qd.copy()
        q[:, self.joint] += lead
        if len(lead) > 1:
            qd[:, self.joint] += np.gradient(lead, motion.t)
        return replace(signals, q=q, qd=qd)
