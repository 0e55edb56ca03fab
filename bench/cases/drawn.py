"""Randomly drawn hidden-effect cases, on which no diagnosis can be tuned."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bench.cases.case_list import bristles, ROLES
from bench.cases.cases import ARMS, Case, Pair, Truth
from gravity_comp_ros.simulation.disturbances.friction import Friction, LoadFriction, LuGre
from gravity_comp_ros.simulation.disturbances.joint_torque import Cogging, DressPack
from gravity_comp_ros.simulation.disturbances.signals import GaugeDrift, GaugeOffset
from gravity_comp_ros.simulation.hidden import noise_levels
from gravity_comp_ros.simulation.synthesise import Disturbance
import numpy as np

Draw = tuple[Disturbance, Truth, frozenset[Pair]]
Maker = Callable[[int, float, np.random.Generator], Draw]
# Joints of the arms of `ROLES` that carry load.
_LOADED = (1, 2, 3)


def drawn_case(arm: str, number: int) -> Case:
    """
    Return case `number` of an arm, with none to two effects on different joints.

    Effects are 3 to 30 times the joint's torque noise. Speed, number of runs and noise correlation
    are random as well.
    """
    rng = np.random.default_rng([number, len(arm), 20])
    noise = noise_levels(ARMS[arm]())
    count = int(rng.choice([0, 1, 2], p=[0.2, 0.5, 0.3]))
    joints = rng.permutation(ROLES[arm].count)[:count]
    draws = [_draw(int(joint), noise[joint], rng, joint in _LOADED) for joint in joints]
    return Case(
        f'drawn_{number}', arm, 'found' if draws else 'nothing',
        tuple(draw[0] for draw in draws), tuple(draw[1] for draw in draws),
        frozenset(pair for draw in draws for pair in draw[2]),
        runs=int(rng.integers(3, 7)), max_speed=float(rng.uniform(0.15, 0.4)),
        correlated=float(rng.uniform(0.0, 0.8)), correlation=float(rng.uniform(0.1, 1.0)))


def draws(arm: str, joints: Sequence[int], rng: np.random.Generator,
          loads: frozenset[int]) -> list[Draw]:
    """Return a random effect for each joint, other than Coulomb and viscous friction."""
    noise = noise_levels(ARMS[arm]())
    return [_draw(joint, noise[joint], rng, joint in loads, _MAKERS[2:]) for joint in joints]


def _draw(joint: int, noise: float, rng: np.random.Generator, loaded: bool,
          makers: tuple[Maker, ...] | None = None) -> Draw:
    size = noise * float(np.exp(rng.uniform(np.log(3.0), np.log(30.0))))
    makers = makers or _MAKERS
    # Load friction requires a loaded joint.
    makers = makers if loaded else makers[:-1]
    return makers[int(rng.integers(len(makers)))](joint, size, rng)


def _coulomb(joint: int, size: float, rng: np.random.Generator) -> Draw:
    presliding = float(np.exp(rng.uniform(np.log(5e-5), np.log(1e-3))))
    truth = Truth('coulomb_friction', joint, values=(size,), unit='N·m')
    return Friction(joint, LuGre(size, presliding=presliding)), truth, bristles(joint)


def _viscous(joint: int, size: float, rng: np.random.Generator) -> Draw:
    coefficient = 10.0 * size
    truth = Truth('viscous_friction', joint, values=(coefficient,), unit='N·m·s/rad')
    return Friction(joint, LuGre(0.0, coefficient)), truth, frozenset()


def _offset(joint: int, size: float, rng: np.random.Generator) -> Draw:
    offset = size * float(rng.choice([-1.0, 1.0]))
    truth = Truth('torque_offset', joint, values=(offset,), unit='N·m')
    return GaugeOffset(joint, offset), truth, frozenset()


def _drift(joint: int, size: float, rng: np.random.Generator) -> Draw:
    rise = size * float(rng.choice([-2.0, 2.0]))
    return (GaugeDrift(joint, rise, float(rng.uniform(150.0, 400.0)), lag=0.25),
            Truth('torque_drift', joint), frozenset({('torque_offset', joint)}))


def _cable(joint: int, size: float, rng: np.random.Generator) -> Draw:
    pack = DressPack(joint, float(rng.uniform(-0.5, 0.5)), 4.0 * size,
                     float(rng.uniform(2.0, 5.0)), int(rng.choice([-1, 1])))
    return pack, Truth('cable_stiffness', joint, (('joint_spring', joint),)), frozenset()


def _cogging(joint: int, size: float, rng: np.random.Generator) -> Draw:
    cogging = Cogging(joint, int(rng.integers(8, 40)), 2.0 * size, float(rng.uniform(0.4, 1.5)),
                      float(rng.uniform(0.0, 1.0)))
    return cogging, Truth('torque_ripple', joint), frozenset()


def _load(joint: int, size: float, rng: np.random.Generator) -> Draw:
    fraction = float(rng.uniform(0.03, 0.12))
    return (LoadFriction(joint, fraction, float(rng.uniform(0.5, 3.0))),
            Truth('load_dependent_friction', joint),
            bristles(joint) | {('coulomb_friction', joint)})


_MAKERS: tuple[Maker, ...] = (_coulomb, _viscous, _offset, _drift, _cable, _cogging, _load)
