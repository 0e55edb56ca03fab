"""
Is friction negligible? Yu 2022, Eq. (18): slow motion, both ways, against torque at rest.

RSE is the squared difference over the squared deviation of the static torque from its mean. The
paper has 0.307 and 0.512 % forward and reverse.
"""

from __future__ import annotations

from dataclasses import dataclass

from bench.paper.scenes import FloatArray, FRICTION, NOISE, real_arm
from gravity_comp_ros.simulation import arms
import numpy as np

_SPEED = 0.1


@dataclass(frozen=True)
class Check:
    """One joint's sweep: angles (M,) in rad, static, forward and reverse torques, and RSE."""

    joint: int
    q: FloatArray
    static: FloatArray
    forward: FloatArray
    reverse: FloatArray
    rse: tuple[float, float]


def check(joint: int, count: int = 200, friction: float = FRICTION) -> Check:
    """Sweep one joint (from 0) at 0.1 rad/s by a radian each way, the others at an angle."""
    arm = real_arm()
    q = np.tile([0.0, 0.4, 0.0, -0.7, 0.0, 0.5, 0.0], (count, 1))
    q[:, joint] += np.linspace(-1.0, 1.0, count)
    rng = np.random.default_rng(joint)
    static = arms.gravity_torque(arm, q)[:, joint]
    static = static + NOISE * rng.normal(size=count)
    both = []
    for way in (1.0, -1.0):
        qd = np.zeros_like(q)
        qd[:, joint] = way * _SPEED
        tau = arms.inverse_dynamics(arm, q, qd, np.zeros_like(q))[:, joint]
        both.append(tau + way * friction + NOISE * rng.normal(size=count))
    spread = ((static - static.mean()) ** 2).sum()
    forward, reverse = (float(((tau - static) ** 2).sum() / spread) for tau in both)
    return Check(joint, q[:, joint], static, both[0], both[1], (forward, reverse))
