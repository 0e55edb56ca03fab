"""
Hidden physics of a case: friction of the gears, and one effect of ordinary size on a joint.

Sizes are relative to the `scale` of a joint: its largest gravity torque within the limits, at
least a tenth of that of the arm. The laws are those of `gravity_comp_ros.simulation`; none is
computed by the library of effects.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bench.shared.findings import Known, Pair
from gravity_comp_ros.simulation.disturbances.friction import Friction, LoadFriction, LuGre
from gravity_comp_ros.simulation.disturbances.signals import (
    angle_torque, cogging, dress_pack, gauge_gain, gauge_offset)
from gravity_comp_ros.simulation.synthesise import Disturbance
import numpy as np

# Joint friction is never false on a joint that has LuGre friction.
FRICTION = ('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'asymmetric_friction',
            'load_dependent_friction', 'degressive_friction', 'friction_drift',
            'coupled_friction', 'presliding_hysteresis')
# The same for a joint whose hidden effect is one friction law: those collinear with its bristles.
BRISTLES = ('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'degressive_friction',
            'presliding_hysteresis')


# Angle in rad over which the stiffness of a wound flat spring rises: by 0.5 % at 1 rad.
_HARDENING = 10.0


@dataclass(frozen=True)
class Hidden:
    """
    A hidden effect: the pairs of effect and joint that name it, its law, and what is known of it.

    `allowed` are findings that are present as well, `static` whether it acts at rest.
    `slack` (N·m) is the constant that the law adds while the joint moves; at rest any part of it
    is right.
    """

    effect: str
    joint: int
    law: Disturbance
    answers: tuple[Pair, ...]
    allowed: tuple[Pair, ...] = ()
    known: Known | None = None
    static: bool = False
    slack: float = 0.0


@dataclass(frozen=True)
class Site:
    """A joint, its scale in N·m, and the box of a case (`low`, `high`) and the limits in rad."""

    joint: int
    scale: float
    low: float
    high: float
    lower: float
    upper: float


Maker = Callable[[Site, np.random.Generator], Hidden]


def gear_friction(site: Site, rng: np.random.Generator) -> Friction:
    """Return LuGre friction with a level of 1 to 4 % of the scale and a Stribeck dip."""
    level = float(rng.uniform(0.01, 0.04) * site.scale)
    return Friction(site.joint, LuGre(
        level, float(level * rng.uniform(0.3, 3.0)), float(level * rng.uniform(1.0, 1.4)),
        float(rng.uniform(0.01, 0.03)), _log(rng, 5e-5, 1e-3)))


def level_of(friction: Friction, max_speed: float) -> Known:
    """Return the Coulomb level: between that at the largest speed and that of breakaway."""
    surfaces = friction.surfaces
    steady = surfaces.coulomb * float(surfaces.shape(np.array(max_speed)))
    return Known('coulomb_friction', friction.joint, 'N·m', steady,
                 max(surfaces.static, surfaces.coulomb))


def _spring(site: Site, rng: np.random.Generator) -> Hidden:
    stiffness = float(rng.uniform(0.05, 0.2) * site.scale)
    rest = float(rng.uniform(site.lower, site.upper))
    law = angle_torque(site.joint, lambda q: stiffness * _HARDENING * np.sinh(
        (q - rest) / _HARDENING))
    slopes = stiffness * np.cosh((np.linspace(site.low, site.high, 50) - rest) / _HARDENING)
    known = Known('joint_spring', site.joint, 'N·m/rad', float(slopes.min()), float(slopes.max()))
    return _hidden('joint_spring', law, known=known, static=True)


def _offset(site: Site, rng: np.random.Generator) -> Hidden:
    size = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.05) * site.scale)
    known = Known('torque_offset', site.joint, 'N·m', size, size)
    return _hidden('torque_offset', gauge_offset(site.joint, size), known=known, static=True)


def _gain(site: Site, rng: np.random.Generator) -> Hidden:
    size = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.12))
    known = Known('torque_gain', site.joint, '', size, size)
    return _hidden('torque_gain', gauge_gain(site.joint, 1.0 + size), known=known, static=True)


def _load(site: Site, rng: np.random.Generator) -> Hidden:
    law = LoadFriction(site.joint, float(rng.uniform(0.03, 0.12)),
                       float(rng.uniform(0.02, 0.1) * site.scale), _log(rng, 5e-5, 1e-3))
    return _hidden('load_dependent_friction', law, allowed=BRISTLES)


def _ripple(site: Site, rng: np.random.Generator) -> Hidden:
    law = cogging(site.joint, int(rng.integers(8, 41)),
                  float(rng.uniform(0.01, 0.03) * site.scale), float(rng.uniform(0.4, 1.5)),
                  float(rng.uniform(0.0, 1.0)))
    return _hidden('torque_ripple', law, static=True)


def _asymmetric(site: Site, rng: np.random.Generator) -> Hidden:
    small = float(rng.uniform(0.01, 0.02) * site.scale)
    large, presliding = float(small * rng.uniform(1.5, 3.0)), _log(rng, 5e-5, 1e-3)
    forward, backward = (large, small) if rng.random() < 0.5 else (small, large)
    surfaces = LuGre(forward, presliding=presliding)
    law = Friction(site.joint, surfaces, surfaces.at_level(backward))
    return _hidden('asymmetric_friction', law, allowed=BRISTLES,
                   slack=0.5 * (forward - backward))


def with_one_level(law: Disturbance) -> Friction | None:
    """Return the friction of the same bristles with one level, None for what is no friction."""
    if isinstance(law, LoadFriction):
        return Friction(law.joint, LuGre(law.fraction * law.preload, presliding=law.presliding))
    return Friction(law.joint, law.surfaces) if isinstance(law, Friction) else None


def _cable(site: Site, rng: np.random.Generator) -> Hidden:
    law = dress_pack(site.joint, float(site.low + rng.uniform(0.2, 0.6) * (site.high - site.low)),
                     float(rng.uniform(0.04, 0.15) * site.scale), float(rng.uniform(2.0, 5.0)),
                     int(rng.choice([-1, 1])))
    return _hidden('cable_stiffness', law, ('joint_spring',), static=True)


def _coulomb(site: Site, rng: np.random.Generator) -> Hidden:
    law = Friction(site.joint, LuGre(float(rng.uniform(0.01, 0.04) * site.scale),
                                     presliding=_log(rng, 5e-5, 1e-3)))
    # Bristles that bend before they slip: either name explains the torque.
    return _hidden('coulomb_friction', law, ('presliding_hysteresis',), allowed=BRISTLES,
                   known=level_of(law, 1.0))


# The hidden Coulomb friction is last: joints with friction of their own gears have it already.
MAKERS: tuple[Maker, ...] = (_spring, _offset, _gain, _load, _ripple, _asymmetric, _cable,
                             _coulomb)


def _hidden(effect: str, law: Any, equivalents: tuple[str, ...] = (),
            allowed: tuple[str, ...] = (), **more: Any) -> Hidden:
    joint = law.joint
    return Hidden(effect, joint, law, tuple((name, joint) for name in (effect, *equivalents)),
                  tuple((name, joint) for name in allowed), **more)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
