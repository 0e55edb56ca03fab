"""A gear between the encoder at the motor and the link: it winds up, or has play."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.disturbances.joint_torque import check_joint
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


def _led(signals: Signals, joint: int, lead: FloatArray, t: FloatArray) -> Signals:
    """Return the signals with the motor's angle, the one reported, ahead by `lead` (M,) in rad."""
    q, qd = signals.q.copy(), signals.qd.copy()
    q[:, joint] += lead
    if len(t) > 1:
        qd[:, joint] += np.gradient(lead, t)
    return replace(signals, q=q, qd=qd)


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
        return _led(signals, self.joint, lead, motion.t)


@dataclass(frozen=True)
class SoftGear:
    """
    A gear of `stiffness` N·m/rad: the motor's angle, the one reported, is q + tau / stiffness.

    `hardening` in (N·m)^-2 makes it stiffer with load, as harmonic drives are: the wind-up is
    then tau / (stiffness (1 + hardening tau^2)^(1/2)).
    """

    joint: int
    stiffness: float
    hardening: float = 0.0

    def __post_init__(self) -> None:
        if not self.stiffness > 0 or not self.hardening >= 0:
            raise OptionError(f'soft gear: stiffness {self.stiffness} N·m/rad must be positive '
                              f'and hardening {self.hardening} 0 or more')

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        load = signals.tau[:, self.joint]
        wound = load / (self.stiffness * np.sqrt(1 + self.hardening * load ** 2))
        return _led(signals, self.joint, wound, motion.t)
