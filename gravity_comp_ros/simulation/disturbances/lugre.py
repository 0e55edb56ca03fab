"""
LuGre friction: elastic bristles between two surfaces that slip at a limit deflection.

    dz/dt = v - |v| z / d(v)          the bristles' deflection z in rad
    F     = s0 z + s1 dz/dt + s2 v    the torque in N·m

where s0 d(v) = level * shape(v) is the force of steady sliding and d(v) its deflection. The
Stribeck shape is Lorentzian,

    shape(v) = 1 + (static / coulomb - 1) / (1 + (v / v_s)^2),

with the level `static` at breakaway and `coulomb` at high speed. (Canudas de Wit et al., "A new
model for control of systems with friction", IEEE Trans. Automatic Control 40(3), 1995, who use a
different shape.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
import numpy as np


@dataclass(frozen=True)
class LuGre:
    """
    Parameters of a pair of surfaces.

    `coulomb` is the level at high speed in N·m, `static` that of breakaway (0: the same),
    `stribeck_speed` in rad/s the speed at which their difference has halved, `viscous` in
    N·m·s/rad, `presliding` the deflection in rad at which the surfaces slip at the level
    `coulomb`, and `damping` in s the ratio s1 / s0.

    :raises OptionError: if a value is negative, or breakaway is below sliding.
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
        check_positive(self, 'friction', 'stribeck_speed', 'presliding')
        if 0 < self.static < self.coulomb:
            raise OptionError(f'friction: breakaway at {self.static} N·m is below sliding at '
                              f'{self.coulomb} N·m')

    @property
    def stiffness(self) -> float:
        """Return s0 in N·m/rad."""
        return self.coulomb / self.presliding

    def at_level(self, coulomb: float) -> LuGre:
        """Return surfaces with other levels and the same bristles: their stiffness stays."""
        ratio = coulomb / self.coulomb
        return replace(self, coulomb=coulomb, static=ratio * self.static,
                       presliding=ratio * self.presliding)

    def shape(self, v: FloatArray) -> FloatArray:
        """Return the Stribeck curve (K,) relative to its high-speed level, at v (K,) in rad/s."""
        excess = max(self.static / self.coulomb - 1.0, 0.0) if self.coulomb > 0 else 0.0
        return np.asarray(1.0 + excess / (1.0 + (v / self.stribeck_speed) ** 2))

    def steady(self, v: FloatArray) -> FloatArray:
        """Return the torque (K,) in N·m of steady sliding at v (K,) in rad/s."""
        return np.asarray(np.sign(v) * self.coulomb * self.shape(v) + self.viscous * v)


def friction_torque(t: FloatArray, q: FloatArray, v: FloatArray, forward: LuGre,
                    backward: LuGre | None = None,
                    normal: FloatArray | float = 1.0) -> FloatArray:
    """
    Return the friction torque (K,) in N·m along q, starting with z = 0.

    The bristle equation is linear in z at constant v, and is solved exactly over each step in
    terms of its distance.

    :param t: (K,) in s. :param q: (K,) in rad. :param v: (K,) in rad/s.
    :param backward: parameters at negative speed, if different.
    :param normal: factor (K,) of the bristle force by the normal force.
    :raises OptionError: if the stiffness or the damping of the bristles depends on the direction.
    """
    backward = backward or forward
    if not (np.isclose(forward.stiffness, backward.stiffness)
            and forward.damping == backward.damping):
        # Their force would jump at a reversal, and each cycle would gain elastic energy.
        raise OptionError('friction: the bristles have one stiffness coulomb / presliding and one '
                          'damping, in both directions')
    middle = np.diff(q) / np.diff(t)
    z = deflection(np.diff(q), _slip(middle, forward, backward))
    viscous = np.where(v >= 0, forward.viscous, backward.viscous)
    rate = v - np.abs(v) * z / _slip(v, forward, backward)
    return np.asarray(normal * forward.stiffness * (z + forward.damping * rate) + viscous * v)


def _slip(v: FloatArray, forward: LuGre, backward: LuGre) -> FloatArray:
    """Return the slip deflection (K,) in rad at speed v."""
    return np.where(v >= 0, forward.presliding * forward.shape(v),
                    backward.presliding * backward.shape(v))


def deflection(moved: FloatArray, slip: FloatArray) -> FloatArray:
    """
    Return the bristle deflection (K,) in rad, starting at 0.

    :param moved: the steps (K - 1,) in rad.
    :param slip: the slip deflection (K - 1,) in rad during each step.
    """
    keep = np.exp(-np.abs(moved) / slip)
    gain = np.sign(moved) * slip * -np.expm1(-np.abs(moved) / slip)
    z, state = [0.0], 0.0
    for k, g in zip(keep.tolist(), gain.tolist()):
        state = k * state + g
        z.append(state)
    return np.array(z)
