"""
Friction in the gear of one joint, or in a differential of two wrist joints.

LuGre friction has elastic bristles between two surfaces that slip at a limit deflection.

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

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np


@dataclass(frozen=True)
class LuGre:
    """
    Parameters of a pair of surfaces.

    `coulomb` is the level at high speed in N·m, `static` that of breakaway (0: the same),
    `stribeck_speed` in rad/s the speed at which their difference has halved, `viscous` in
    N·m·s/rad, `presliding` the deflection in rad at which the surfaces slip at the level
    `coulomb`, and `damping` in s the ratio s1 / s0.

    Beyond the speed `thinning` in rad/s viscous friction is degressive, as that of grease: the
    stress is thinning asinh(v / thinning) at the shear rate v (H. Eyring, Viscosity, plasticity,
    and diffusion as examples of absolute reaction rates, J. Chem. Phys. 4, 1936).
    """

    coulomb: float
    viscous: float = 0.0
    static: float = 0.0
    stribeck_speed: float = 0.03
    presliding: float = 2e-4
    damping: float = 0.002
    thinning: float = np.inf

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
    oil = v if forward.thinning == np.inf else forward.thinning * np.arcsinh(v / forward.thinning)
    rate = v - np.abs(v) * z / _slip(v, forward, backward)
    return np.asarray(normal * forward.stiffness * (z + forward.damping * rate) + viscous * oil)


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


# Vogel's law of a synthetic gear oil: viscosity ~ exp(B / (T - T0)), T in degrees Celsius.
VOGEL_B = 900.0
VOGEL_T0 = -95.0
# Largest integration step, s.
_STEP = 0.005


class JointFriction(ABC):
    """Friction of joint number `joint`, counted from 0, with a state: integrated in fine steps."""

    joint: int

    @abstractmethod
    def friction(self, t: FloatArray, q: FloatArray, v: FloatArray, load: FloatArray
                 ) -> FloatArray:
        """
        Return the torque (K,) in N·m.

        :param t: s. :param q: rad. :param v: rad/s. :param load: N·m, each (K,).
        """

    def apply(self, signals: Signals, motion: Motion, arm: Arm) -> Signals:
        fine, parts = in_fine_steps(motion)
        tau, n = signals.tau.copy(), self.joint
        load = np.interp(fine.t, motion.t, tau[:, n])
        tau[:, n] += self.friction(fine.t, fine.q[:, n], fine.qd[:, n], load)[::parts]
        return replace(signals, tau=tau)


def in_fine_steps(motion: Motion) -> tuple[Motion, int]:
    """Return the motion in steps of at most `_STEP` s, and the number of steps per sample."""
    gaps = np.diff(motion.t)
    parts = 1 if gaps.size == 0 else max(1, int(np.ceil(gaps.max() / _STEP - 1e-9)))
    if parts == 1:
        return motion, 1
    inner = motion.t[:-1, None] + gaps[:, None] * np.arange(parts) / parts
    t = np.append(inner.ravel(), motion.t[-1])
    return Motion(motion.name, t, *motion.path(t), motion.path), parts


@dataclass(frozen=True)
class Friction(JointFriction):
    """
    LuGre friction on a joint, counted from 0, with other parameters `backward` if given.

    A long presliding distance appears as hysteresis at reversals.
    """

    joint: int
    surfaces: LuGre
    backward: LuGre | None = None

    def friction(self, t: FloatArray, q: FloatArray, v: FloatArray, load: FloatArray
                 ) -> FloatArray:
        return friction_torque(t, q, v, self.surfaces, self.backward)


@dataclass(frozen=True)
class LoadFriction(JointFriction):
    """
    LuGre friction with a sliding level proportional to the normal force of the gear's teeth.

    The preload of the teeth is perpendicular to the transmitted force, so that

        level = fraction * sqrt(preload^2 + load^2),

    which is the `fraction` of the transmitted torque `load`, in N·m, far above `preload`.
    """

    joint: int
    fraction: float
    preload: float = 3.0
    presliding: float = 2e-4

    def friction(self, t: FloatArray, q: FloatArray, v: FloatArray, load: FloatArray
                 ) -> FloatArray:
        surfaces = LuGre(self.fraction, presliding=self.presliding)
        return friction_torque(t, q, v, surfaces, normal=np.hypot(self.preload, load))


@dataclass(frozen=True)
class ThermalFriction(JointFriction):
    """
    LuGre friction in a gear of temperature T, in degrees Celsius.

        capacity dT/dt = idle + |friction * qd| - (T - room) / resistance

    The time constant is `resistance` (K/W) times `capacity` (J/K); `idle` W is the heat of motor
    and brake. The viscous coefficient follows Vogel's law; the bristle force falls by the fraction
    `softening` per kelvin, down to a fifth. T starts at `begin`, by default at `room`.
    """

    joint: int
    surfaces: LuGre
    idle: float = 3.0
    resistance: float = 6.0
    capacity: float = 12.0
    softening: float = 0.015
    room: float = 22.0
    begin: float | None = None

    def dry_factor(self, temperature: FloatArray) -> FloatArray:
        return np.asarray(np.maximum(1 - self.softening * (temperature - self.room), 0.2))

    def viscosity_factor(self, temperature: FloatArray) -> FloatArray:
        cold = VOGEL_B / (self.room - VOGEL_T0)
        return np.asarray(np.exp(VOGEL_B / (temperature - VOGEL_T0) - cold))

    def temperature(self, t: FloatArray, cold_power: FloatArray) -> FloatArray:
        """
        Return T (K,) at times t (K,) in s.

        :param cold_power: |friction * qd| (K,) in W at room temperature; it is scaled with the
            dry friction.
        """
        keep = np.exp(-np.diff(t) / (self.resistance * self.capacity))
        state = self.room if self.begin is None else self.begin
        out = [state]
        for power, k in zip(cold_power.tolist(), keep.tolist()):
            factor = max(1 - self.softening * (state - self.room), 0.2)
            target = self.room + self.resistance * (self.idle + factor * power)
            state = target + (state - target) * k
            out.append(state)
        return np.array(out)

    def friction(self, t: FloatArray, q: FloatArray, v: FloatArray, load: FloatArray
                 ) -> FloatArray:
        cold = friction_torque(t, q, v, self.surfaces)
        warm = self.temperature(t, np.abs(cold * v))
        oil = self.surfaces.viscous * v
        return self.dry_factor(warm) * (cold - oil) + self.viscosity_factor(warm) * oil


@dataclass(frozen=True)
class DifferentialFriction:
    """
    LuGre friction on the sum shaft, q_a + q_b, of a differential that drives a pair of joints.

    It acts on both joints.
    """

    pair: tuple[int, int]
    surfaces: LuGre

    def apply(self, signals: Signals, motion: Motion, arm: Arm) -> Signals:
        (fine, parts), tau, pair = in_fine_steps(motion), signals.tau.copy(), list(self.pair)
        torque = friction_torque(fine.t, fine.q[:, pair].sum(axis=1),
                                 fine.qd[:, pair].sum(axis=1), self.surfaces)
        tau[:, pair] += torque[::parts, None]
        return replace(signals, tau=tau)
