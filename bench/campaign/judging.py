"""
Test cases, unused for tuning: friction on every joint, further effects, degraded recordings.

Arm, kind and seed determine a case. A diagnosis has to name Coulomb friction of every joint. It
may name the viscous friction, which is present as well.
"""

from __future__ import annotations

from collections.abc import Callable

from bench.cases.cases import ARMS, Case, Truth
from bench.cases.signals import (
    Degradation, filtered_torque, lost_messages, no_velocity, stepped_torque)
from bench.shared.findings import Known, Pair
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import gravity_torque
from gravity_comp_ros.simulation.disturbances.friction import (
    Friction, LoadFriction, LuGre, ThermalFriction)
from gravity_comp_ros.simulation.disturbances.signals import (
    cogging, dress_pack, gauge_drift, gauge_offset)
from gravity_comp_ros.simulation.hidden import noise_levels
from gravity_comp_ros.simulation.synthesise import Disturbance
import numpy as np

Draw = tuple[Disturbance, Truth, frozenset[Pair]]
Maker = Callable[[int, float, np.random.Generator], Draw]

KINDS = ('friction', 'one_beside', 'two_beside', 'three_beside', 'lost', 'filtered', 'stepped',
         'no_velocity', 'drift', 'warming', 'one_way')
# Number of effects in addition to friction.
_ADDITIONAL = {'one_beside': 1, 'two_beside': 2, 'three_beside': 3, 'lost': 1, 'filtered': 1,
               'stepped': 1, 'no_velocity': 1}
_DEGRADED: dict[str, tuple[Degradation, ...]] = {
    'lost': (lost_messages,), 'filtered': (filtered_torque,), 'stepped': (stepped_torque,),
    'no_velocity': (no_velocity,)}
# Runs of a session, and the pause between them in s.
_SESSION_RUNS, _SESSION_PAUSE = 6, 90.0


def judging_case(arm: str, kind: str, seed: int) -> Case:
    """
    Return a test case of an arm.

    :raises OptionError: if the kind or the arm does not exist.
    """
    if kind not in KINDS or arm not in ARMS:
        raise OptionError(f'no judging case {kind} of arm {arm}; there are {", ".join(KINDS)}')
    rng = np.random.default_rng([seed, KINDS.index(kind), sum(arm.encode()), 1])
    if kind == 'drift':
        return _drift(arm, rng)
    if kind == 'warming':
        return _warming(arm, rng)
    if kind == 'one_way':
        return _one_way(arm, rng)
    return _friction_and_effects(arm, kind, rng)


def _friction_and_effects(arm: str, kind: str, rng: np.random.Generator) -> Case:
    """Return a case with friction on every joint, and random effects on some of them."""
    levels = _friction_levels(arm, rng)
    n = len(levels)
    joints = [int(j) for j in rng.permutation(n)[:_ADDITIONAL.get(kind, 0)]]
    noise, loads = noise_levels(ARMS[arm]()), _loads(arm)
    effects = [_drawn(j, noise[j], rng, j in loads) for j in joints]
    allowed = bristles(*range(n)) | {('viscous_friction', j) for j in range(n)}
    if kind == 'filtered':
        # A filter delays the torque; delayed friction is nearly collinear with presliding.
        allowed |= {('time_delay', j) for j in range(n)}
    return Case(
        kind, arm,
        disturbances=(*(Friction(j, LuGre(*level)) for j, level in enumerate(levels)),
                      *(disturbance for disturbance, _, _ in effects)),
        truths=(*(coulomb(j, level[0]) for j, level in enumerate(levels)),
                *(truth for _, truth, _ in effects)),
        allowed=allowed.union(*(more for _, _, more in effects)),
        max_speed=float(rng.uniform(0.25, 0.4)), degraded=_DEGRADED.get(kind, ()))


def _friction_levels(arm: str, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Return Coulomb (N·m) and viscous friction (N·m·s/rad) of 1 to 4 % of gravity's range."""
    built = ARMS[arm]()
    poses = rng.uniform(built.lower, built.upper, (300, built.n_joints))
    spans = np.ptp(gravity_torque(built, poses), axis=0)
    minimum = 5.0 * np.array(noise_levels(built))
    levels = np.maximum(rng.uniform(0.01, 0.04, len(spans)) * spans, minimum)
    return [(float(c), float(c * rng.uniform(0.3, 3.0))) for c in levels]


def _loads(arm: str) -> frozenset[int]:
    """Return the joints whose gravity varies enough for load-dependent friction."""
    built = ARMS[arm]()
    poses = np.random.default_rng(0).uniform(built.lower, built.upper, (300, built.n_joints))
    spans = np.ptp(gravity_torque(built, poses), axis=0)
    return frozenset(int(j) for j in np.flatnonzero(spans > 0.3 * spans.max()))


def _drift(arm: str, rng: np.random.Generator) -> Case:
    """Return a case with a torque sensor zero that drifts over six runs in twenty minutes."""
    noise = noise_levels(ARMS[arm]())
    joint = int(rng.integers(len(noise)))
    rise = float(rng.choice([-1.0, 1.0]) * rng.uniform(8.0, 20.0) * noise[joint])
    warming = float(rng.uniform(300.0, 900.0))
    period = 100.0 + _SESSION_PAUSE
    runs = tuple((k, gauge_drift(joint, rise, warming, begun=k * period, lag=0.25))
                 for k in range(_SESSION_RUNS))
    alternatives: tuple[Pair, ...] = (('friction_drift', joint), ('payload_change', None))
    return Case('drift', arm, truths=(Truth('torque_drift', joint, alternatives),), in_run=runs,
                allowed=frozenset({('torque_offset', joint)}), runs=_SESSION_RUNS,
                duration=100.0, pause=_SESSION_PAUSE)


def _warming(arm: str, rng: np.random.Generator) -> Case:
    """Return a case with a gear that warms over six runs in twenty minutes."""
    noise = noise_levels(ARMS[arm]())
    joint = int(rng.integers(len(noise)))
    level = float(rng.uniform(15.0, 30.0) * noise[joint])
    minutes = float(rng.uniform(300.0, 700.0))
    gear = ThermalFriction(joint, LuGre(level, 2.0 * level), capacity=minutes / 6.0)
    period, idle = 100.0 + _SESSION_PAUSE, gear.resistance * gear.idle
    runs = tuple(
        (k, ThermalFriction(joint, gear.surfaces, capacity=gear.capacity,
                            begin=gear.room - idle * float(np.expm1(-k * period / minutes))))
        for k in range(_SESSION_RUNS))
    return Case('warming', arm, truths=(Truth('friction_drift', joint),), in_run=runs,
                allowed=bristles(joint) | {('coulomb_friction', joint),
                                           ('viscous_friction', joint)},
                runs=_SESSION_RUNS, duration=100.0, pause=_SESSION_PAUSE)


def _one_way(arm: str, rng: np.random.Generator) -> Case:
    """Return a case with friction on a joint without reversals, collinear with an offset."""
    levels = _friction_levels(arm, rng)
    joint = int(rng.integers(1, len(levels)))
    level = levels[joint][0]
    return Case('one_way', arm, True, (Friction(joint, LuGre(level)),),
                truths=(coulomb(joint, level), offset(joint)), one_way=joint)


def coulomb(joint: int, level: float | None = None) -> Truth:
    return _truth('coulomb_friction', joint, level)


def offset(joint: int, zero: float | None = None) -> Truth:
    return _truth('torque_offset', joint, zero)


def _truth(effect: str, joint: int, size: float | None) -> Truth:
    """Return a true effect of a size in N·m, None if it is not judged."""
    return Truth(effect, joint, known=None if size is None else Known(
        effect, joint, 'N·m', size, size))


def bristles(*joints: int) -> frozenset[Pair]:
    """Return the presliding hysteresis of LuGre friction at reversals."""
    return frozenset(('presliding_hysteresis', joint) for joint in joints)


def _drawn(joint: int, noise: float, rng: np.random.Generator, loaded: bool) -> Draw:
    """Return a random effect of 3 to 30 times the joint's torque noise in N·m."""
    size = noise * float(np.exp(rng.uniform(np.log(3.0), np.log(30.0))))
    makers = _MAKERS if loaded else _MAKERS[:-1]
    return makers[int(rng.integers(len(makers)))](joint, size, rng)


def _offset(joint: int, size: float, rng: np.random.Generator) -> Draw:
    zero = size * float(rng.choice([-1.0, 1.0]))
    return gauge_offset(joint, zero), offset(joint, zero), frozenset()


def _rise(joint: int, size: float, rng: np.random.Generator) -> Draw:
    rise = size * float(rng.choice([-2.0, 2.0]))
    return (gauge_drift(joint, rise, float(rng.uniform(150.0, 400.0)), lag=0.25),
            Truth('torque_drift', joint), frozenset({('torque_offset', joint)}))


def _cable(joint: int, size: float, rng: np.random.Generator) -> Draw:
    pack = dress_pack(joint, float(rng.uniform(-0.5, 0.5)), 4.0 * size,
                      float(rng.uniform(2.0, 5.0)), int(rng.choice([-1, 1])))
    return pack, Truth('cable_stiffness', joint, (('joint_spring', joint),)), frozenset()


def _cogging(joint: int, size: float, rng: np.random.Generator) -> Draw:
    law = cogging(joint, int(rng.integers(8, 40)), 2.0 * size, float(rng.uniform(0.4, 1.5)),
                  float(rng.uniform(0.0, 1.0)))
    return law, Truth('torque_ripple', joint), frozenset()


def _load(joint: int, size: float, rng: np.random.Generator) -> Draw:
    fraction = float(rng.uniform(0.03, 0.12))
    return (LoadFriction(joint, fraction, float(rng.uniform(0.5, 3.0))),
            Truth('load_dependent_friction', joint),
            bristles(joint) | {('coulomb_friction', joint)})


# Load friction, which requires a loaded joint, is last.
_MAKERS: tuple[Maker, ...] = (_offset, _rise, _cable, _cogging, _load)
