"""
LuGre friction: bristles between two surfaces bend, hold, and slip.

    dz/dt = v - |v| z / d(v)          the bristles' deflection z in rad
    F     = s0 z + s1 dz/dt + s2 v    the torque in N·m

where s0 d(v) = level * shape(v) is the force of steady sliding and d(v) the deflection that it
belongs to. The Stribeck shape is Lorentzian,

    shape(v) = 1 + (static / coulomb - 1) / (1 + (v / v_s)^2),

so that breakaway takes `static` and fast sliding `coulomb`. (Canudas de Wit et al., "A new
model for control of systems with friction", IEEE Trans. Automatic Control 40(3), 1995, with
another curve than theirs.)
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
import numpy as np


@dataclass(frozen=True)
class LuGre:
    """
    The parameters of one pair of surfaces.

    `coulomb` is the level of fast sliding in N·m, `static` that of breakaway (0: the same),
    `stribeck_speed` in rad/s the speed at which half of their difference is gone, `viscous` in
    N·m·s/rad, `presliding` the deflection in rad at which the surfaces slip at the level
    `coulomb`, and `damping` the time in s by which bristle damping s1 = damping * s0 acts.

    :raises OptionError: if a value is negative, or breakaway takes less than sliding.
    """

    coulomb: float
    viscous: float = 0.0
    static: float = 0.0
    stribeck_speed: float = 0.03
    presliding: float = 2e-4
    damping: float = 0.002

    def __post_init__(self) -> None:
        for field in ('coulomb', 'viscous', 'static', 'damping'):
            value = getattr(self, field)
            if not np.isfinite(value) or value < 0:
                raise OptionError(f'friction: {field} is {value}; it must be 0 or more')
        for field in ('stribeck_speed', 'presliding'):
            value = getattr(self, field)
            if not np.isfinite(value) or value <= 0:
                raise OptionError(f'friction: {field} is {value}; it must be positive')
        if 0 < self.static < self.coulomb:
            raise OptionError(f'friction: breakaway at {self.static} N·m is below sliding at '
                              f'{self.coulomb} N·m')

    @property
    def stiffness(self) -> float:
        """Return s0 in N·m/rad."""
        return self.coulomb / self.presliding

    def shape(self, v: FloatArray) -> FloatArray:
        """Return the Stribeck curve over its level at high speed, (K,) from v (K,) in rad/s."""
        excess = max(self.static / self.coulomb - 1.0, 0.0) if self.coulomb > 0 else 0.0
        return np.asarray(1.0 + excess / (1.0 + (v / self.stribeck_speed) ** 2))

    def steady(self, v: FloatArray) -> FloatArray:
        """Return the torque (K,) in N·m of sliding on and on at v (K,) in rad/s."""
        return np.asarray(np.sign(v) * self.coulomb * self.shape(v) + self.viscous * v)


def friction_torque(t: FloatArray, q: FloatArray, v: FloatArray, forward: LuGre,
                    backward: LuGre | None = None,
                    normal: FloatArray | float = 1.0) -> FloatArray:
    """
    Return the torque (K,) in N·m that moves the surfaces along q, from rest with z = 0.

    The bristle equation is linear in z while v keeps its value, and is solved exactly over
    each step, in terms of the distance that the step covers.

    :param t: (K,) in s. :param q: (K,) in rad. :param v: (K,) in rad/s.
    :param backward: the surfaces' parameters at negative speed, if they are others.
    :param normal: factor (K,) by which a normal force multiplies the bristles' force.
    """
    backward = backward or forward
    middle = np.diff(q) / np.diff(t)
    z = deflection(np.diff(q), _slip(middle, forward, backward))
    ahead = v >= 0
    stiffness = np.where(ahead, forward.stiffness, backward.stiffness)
    damping = stiffness * np.where(ahead, forward.damping, backward.damping)
    viscous = np.where(ahead, forward.viscous, backward.viscous)
    rate = v - np.abs(v) * z / _slip(v, forward, backward)
    return np.asarray(normal * (stiffness * z + damping * rate) + viscous * v)


def _slip(v: FloatArray, forward: LuGre, backward: LuGre) -> FloatArray:
    """Return the deflection (K,) in rad at which surfaces at speed v slip."""
    return np.where(v >= 0, forward.presliding * forward.shape(v),
                    backward.presliding * backward.shape(v))


def deflection(moved: FloatArray, slip: FloatArray) -> FloatArray:
    """
    Return how far bristles are bent, (K,) in rad: at first not, then after each of K - 1 steps.

    :param moved: the steps (K - 1,) in rad.
    :param slip: the deflection (K - 1,) in rad at which the surfaces slip during each.
    """
    keep = np.exp(-np.abs(moved) / slip)
    gain = np.sign(moved) * slip * -np.expm1(-np.abs(moved) / slip)
    z, state = [0.0], 0.0
    for k, g in zip(keep.tolist(), gain.tolist()):
        state = k * state + g
        z.append(state)
    return np.array(z)
