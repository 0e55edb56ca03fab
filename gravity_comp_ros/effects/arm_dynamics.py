"""
What the torque of motion of an arm is linear in: the columns of rigid-body dynamics.

With the axes of a description the columns are the torque of a nominal arm with the first moments
of gravity, and inertias beside it (`DescribedDynamics`). Without one the axes and moments are
those of a chain, and the lengths between axes are coefficients as well (`ChainDynamics`). Most
motions do not show all coefficients, so each has a prior.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.effects.effect import Coefficient, Coefficients
from gravity_comp_ros.models.base_level import is_level
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.nominal_arm import mean_inertia, nominal_parameters
from gravity_comp_ros.models.kinematic.rigid_body import identifiable, PARAMETERS, regressor
from gravity_comp_ros.models.kinematic.unknown_lengths import (
    INERTIAS, motion_columns, product_columns)
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np

# Samples whose regressor is built at once, and poses at which moments are read off a model.
_AT_ONCE, _POSES = 4096, 256
# Correlation from which on two functions of the pose are told from unrelated ones, and cosine from
# which on two axes are parallel.
_SHOWS, _PARALLEL = 0.1, 0.98
# Settings that say which way vertical axes turn, in their order.
WAYS = ('way', 'way_2')
# How far inertias differ from those of the nominal arm, relative to what its joint carries; how
# large a rotor is, and what every joint carries at least, relative to the joint that carries most.
_DIFFERS, _ROTOR, _LEAST = 0.2, 0.02, 0.01
# m: how far masses usually are from the axis that carries them, and axes from each other.
_LENGTH, _BETWEEN = 0.4, 0.1
NOMINAL = Coefficient('s', '', 'share of the torque of motion of a nominal arm, which is made of '
                               'the first moments of gravity')


class Dynamics(ABC):
    """
    Columns of the torque of motion, and how large their coefficients (K,) are before any data.

    `usual` (K,) are standard deviations, inf where a coefficient is free.
    """

    usual: FloatArray

    @abstractmethod
    def coefficients(self) -> Coefficients:
        """Return what each column is multiplied by."""

    @abstractmethod
    def columns(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        """Return the columns (M, N, K) for angles, speeds and accelerations (M, N)."""


@dataclass(frozen=True, eq=False)
class DescribedDynamics(Dynamics):
    """
    The torque of an arm with known axes: nominal parameters (10 N,), inertias and rotors.

    `inertias` (K,) are parameter numbers, `rotors` (R,) joint numbers.
    """

    geometry: Geometry
    nominal: FloatArray
    inertias: IntArray
    rotors: IntArray
    usual: FloatArray

    @classmethod
    def of(cls, model: GravityModel, geometry: Geometry) -> DescribedDynamics:
        """Return the dynamics whose first moments are those of a gravity model."""
        inertias, rotors = identifiable(geometry)
        nominal = nominal_parameters(geometry, first_moments(model, geometry))
        carried = _at_least(mean_inertia(geometry, nominal))
        usual = np.concatenate([[np.inf], _DIFFERS * carried[inertias // 10],
                                np.full(len(rotors), _ROTOR * carried.max())])
        return cls(geometry, nominal, inertias, rotors, usual)

    def coefficients(self) -> Coefficients:
        return (NOMINAL, *(_inertia(k // 10, PARAMETERS[k % 10], ' beyond that of the nominal arm')
                           for k in map(int, self.inertias)), *map(_rotor, self.rotors))

    def columns(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        k = 1 + len(self.inertias)
        found = np.zeros((*q.shape, k + len(self.rotors)))
        for start in range(0, len(q), _AT_ONCE):
            rows = slice(start, start + _AT_ONCE)
            every = regressor(self.geometry, q[rows], qd[rows], qdd[rows])
            found[rows, :, 0] = every @ self.nominal
            found[rows, :, 1:k] = every[:, :, self.inertias]
        for place, joint in enumerate(self.rotors):
            found[:, joint, k + place] = qdd[:, joint]
        return found


@dataclass(frozen=True, eq=False)
class ChainDynamics(Dynamics):
    """
    The torque of an arm whose axes and moments are those of a chain, its lengths unknown.

    `balls` (N,) in kg·m^2 are the inertias of the nominal arm (`motion_columns`). Of `n_vertical`
    axes gravity shows no moment.
    """

    chain: Chain
    balls: FloatArray
    usual: FloatArray
    n_vertical: int

    @classmethod
    def of(cls, chain: Chain, n_vertical: int = 0) -> ChainDynamics:
        """Return the dynamics of a chain; what a joint carries is estimated from its moments."""
        n = chain.n_joints
        if n_vertical > 1:
            moments = chain.moments.copy()
            moments[:n_vertical] = 0.0
            chain = Chain(chain.axes, moments)
        balls = _at_least(_LENGTH * np.linalg.norm(chain.moments, axis=1) / STANDARD_GRAVITY)
        carried = np.cumsum(balls[::-1])[::-1]
        differ = _DIFFERS * carried
        usual = np.concatenate([[np.inf], differ[:1], np.repeat(differ[1:], len(INERTIAS)),
                                np.full(3 * (n - 1), _BETWEEN),
                                np.full(n - 1, _ROTOR * carried.max()),
                                np.full(2 if n_vertical > 1 else 0, carried[1:2].sum())])
        return cls(chain, balls, usual, n_vertical)

    def coefficients(self) -> Coefficients:
        n = self.chain.n_joints
        lengths = (_length(joint, axis) for joint in range(1, n) for axis in 'xyz')
        inertias = (_inertia(link, kind) for link in range(1, n) for kind in INERTIAS)
        products = (_product(2, axis) for axis in 'xy' if self.n_vertical > 1)
        return (NOMINAL, _inertia(0, 'Izz'), *inertias, *lengths, *map(_rotor, range(1, n)),
                *products)

    def columns(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        n = self.chain.n_joints
        rotors = np.zeros((len(q), n, n - 1))
        rotors[:, np.arange(1, n), np.arange(n - 1)] = qdd[:, 1:]
        parts = [motion_columns(self.chain, self.balls, q, qd, qdd), rotors]
        if self.n_vertical > 1:
            parts.append(product_columns(self.chain, q, qd, qdd))
        return np.concatenate(parts, axis=2)


def _at_least(carried: FloatArray) -> FloatArray:
    """Return inertias (N,) in kg·m^2 about each joint, none next to nothing."""
    return np.maximum(carried, max(_LEAST * float(carried.max()), 1e-6))


def _inertia(link: int, kind: str, beyond: str = '') -> Coefficient:
    return Coefficient(f'{kind}_{link + 1}', 'kg·m^2',
                       f'{kind} of link number {link + 1}{beyond}, what it carries included')


def _length(joint: int, axis: str) -> Coefficient:
    return Coefficient(f'{axis}_{joint + 1}', 'm', f'where axis {joint + 1} lies in link number '
                                                   f'{joint}, along {axis}')


def _product(joint: int, axis: str) -> Coefficient:
    return Coefficient(f'hp{axis}_{joint}', 'kg·m^2', f'moment about axis {joint} times the '
                                                      f'length to it, along {axis}')


def _rotor(joint: int) -> Coefficient:
    return Coefficient(f'J_{joint + 1}', 'kg·m^2', f'inertia of the rotor of joint number '
                                                   f'{joint + 1}, behind its gear')


@lru_cache(maxsize=4)
def described_dynamics(model: GravityModel) -> DescribedDynamics | None:
    """Return the dynamics of a gravity model with known axes; None if it has none."""
    return None if model.geometry is None else DescribedDynamics.of(model, model.geometry)


@lru_cache(maxsize=4)
def chain_dynamics(chain: Chain, ways: tuple[float, ...] = ()) -> ChainDynamics:
    """Return the dynamics of a chain whose vertical axes turn these `ways` (`turned`)."""
    return ChainDynamics.of(turned(chain, ways), len(ways))


def axis_sign_options(chain: Chain, q: FloatArray) -> list[tuple[float, ...]]:
    """
    Return the ways in which a chain's axes may turn by its gravity at q (M, N) (`turned`).

    An axis counts that carries no gravity and is vertical in every pose: the first one of a level
    base, and the next ones that are parallel to it, as in a SCARA.
    """
    count = 0
    if chain.n_joints > 1 and len(q) > 0 and is_level(chain.torque(q)):
        count, most = 1, min(chain.n_joints - 1, len(WAYS))
        while count < most and abs(chain.axes[count][2, 2]) > _PARALLEL:
            count += 1
    return list(product((1.0, -1.0), repeat=count))


def ways_of(chain: Chain, q: FloatArray) -> tuple[float, ...]:
    """Return the way in which each axis turns whose way gravity at q (M, N) does not show."""
    return tuple(way_of(chain, axis) for axis in range(len(axis_sign_options(chain, q)[0])))


def turned(chain: Chain, ways: tuple[float, ...]) -> Chain:
    """
    Return the chain whose first axes turn one way (1) or the other (-1); none is left as it is.

    Gravity does not show which way a vertical axis turns: no height depends on its angle. The
    torque of motion does, since it couples that joint to the others.
    """
    half_turn = np.diag([1.0, -1.0, -1.0])
    for joint, way in enumerate(ways):
        if way * way_of(chain, joint) >= 0.0:
            continue
        axes, moments = chain.axes.copy(), chain.moments.copy()
        axes[joint], axes[joint + 1] = axes[joint] @ half_turn, half_turn @ axes[joint + 1]
        moments[joint, 1] *= -1.0
        chain = Chain(axes, moments)
    return chain


def way_of(chain: Chain, vertical: int = 0) -> float:
    """
    Return which way a vertical axis turns: 1 or -1, or 0 where both are the same arm.

    A mirror image has the same gravity and the same kinetic energy, and its first axis points the
    other way. So the way is told by what a mirror leaves: the angle between the vertical axis and
    the next one that is not fixed to it, against the gravity torque of the joint that moves that.
    """
    n = chain.n_joints
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSES, n))
    gravity = chain.torque(q)
    for joint in range(vertical + 1, n - 1):
        later = q.copy()
        later[:, joint] += 0.5 * np.pi
        between = (_between(chain, q, vertical, joint + 1)
                   + _between(chain, later, vertical, joint + 1))
        common = float(((between - between.mean()) * gravity[:, joint]).mean())
        if abs(common) > _SHOWS * float(between.std() * gravity[:, joint].std()) > 0.0:
            return float(np.sign(common))
    return 0.0


def _between(chain: Chain, q: FloatArray, vertical: int, joint: int) -> FloatArray:
    """Return the cosine (M,) of the angle between a vertical axis and that of a joint."""
    axes = ForwardKinematics(chain.axes, q).rotated[:, 2]
    return np.asarray((axes[vertical] * axes[joint]).sum(axis=0))


def first_moments(model: GravityModel, geometry: Geometry) -> FloatArray:
    """
    Return the first moments (N, 2) of a gravity model about known axes, in kg·m.

    They are those of its chain, or what comes nearest to its torque over the trained range.
    """
    chain = model.chain
    if chain is not None and np.allclose(chain.axes[1:], geometry.rotations[1:], atol=1e-6):
        return chain.moments / STANDARD_GRAVITY
    low, high = model.coverage.q_min, model.coverage.q_max
    q = np.random.default_rng(0).uniform(low, np.maximum(high, low), (_POSES, model.n_joints))
    columns = ForwardKinematics(geometry.rotations, q).moment_columns()
    flat = columns.reshape(len(columns), -1).T
    found = lstsq(flat, model.predict(q).T.ravel(), rcond=1e-6)
    return np.asarray(found.reshape(-1, 2) / STANDARD_GRAVITY)
