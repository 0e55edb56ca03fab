"""
Friction test of Yu 2022, Eq. (18): slow motion in both directions compared with torque at rest.

RSE is the squared difference over the squared deviation of the static torque from its mean. The
paper reports 0.307 % forward and 0.512 % reverse.
"""

from __future__ import annotations

from dataclasses import dataclass

from bench.paper.scenes import FloatArray, FRICTION, NOISE, real_arm
from gravity_comp_ros.simulation import arms
import numpy as np

# Speed of the joint in rad/s.
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
    """Sweep one joint (index from 0) at 0.1 rad/s over ±1 rad, with the other joints fixed."""
    arm = real_arm()
    q = np.tile([0.0, 0.4, 0.0, -0.7, 0.0, 0.5, 0.0], (count, 1))
    q[:, joint] += np.linspace(-1.0, 1.0, count)
    rng = np.random.default_rng(joint)
    static = arms.gravity_torque(arm, q)[:, joint]
    static = static + NOISE * rng.normal(size=count)
    moving = []
    for direction in (1.0, -1.0):
        qd = np.zeros_like(q)
        qd[:, joint] = direction * _SPEED
        tau = arms.inverse_dynamics(arm, q, qd, np.zeros_like(q))[:, joint]
        moving.append(tau + direction * friction + NOISE * rng.normal(size=count))
    spread = ((static - static.mean()) ** 2).sum()
    forward, reverse = (float(((tau - static) ** 2).sum() / spread) for tau in moving)
    return Check(joint, q[:, joint], static, moving[0], moving[1], (forward, reverse))
