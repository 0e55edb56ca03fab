"""
Columns of an arm's dynamic torque: inertial, centrifugal and Coriolis torque.

With known axes the columns are the torque of a nominal arm with the first moments of gravity,
and further inertias (`DescribedDynamics`). Without a description, axes and moments are those of
a chain, and the lengths between axes are coefficients too (`ChainDynamics`). Most motions do not
excite all coefficients, so each has a prior.
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

# Samples per batch of the regressor, and number of poses for the moments of a model.
_BATCH, _POSES = 4096, 256
# Minimum correlation of two functions of the pose, and minimum cosine of parallel axes.
_MIN_CORRELATION, _PARALLEL = 0.1, 0.98
# Settings with the signs of vertical axes, in their order.
SIGN_SETTINGS = ('way', 'way_2')
# Prior standard deviation of inertias, relative to the nominal inertia about their joint; that of
# rotors, and minimum inertia about a joint, both relative to the largest.
_INERTIA_STD, _ROTOR_STD, _MIN_INERTIA = 0.2, 0.02, 0.01
# Typical distance of masses from their joint axis, and prior standard deviation of lengths
# between axes, in m.
_LENGTH, _LENGTH_STD = 0.4, 0.1
NOMINAL = Coefficient('s', '', 'share of the dynamic torque of a nominal arm with the first '
                               'moments of gravity')


class Dynamics(ABC):
    """Columns of the dynamic torque; `prior_std` (K,) is inf where a coefficient is free."""

    prior_std: FloatArray

    @abstractmethod
    def coefficients(self) -> Coefficients:
        """Return the coefficient of each column."""

    @abstractmethod
    def columns(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        """Return the columns (M, N, K) for angles, speeds and accelerations (M, N)."""


@dataclass(frozen=True, eq=False)
class DescribedDynamics(Dynamics):
    """
    Dynamic torque of an arm with known axes: nominal parameters (10 N,), inertias, rotors.

    `inertias` (K,) are parameter numbers, `rotors` (R,) joint numbers.
    """

    geometry: Geometry
    nominal: FloatArray
    inertias: IntArray
    rotors: IntArray
    prior_std: FloatArray

    @classmethod
    def of(cls, model: GravityModel, geometry: Geometry) -> DescribedDynamics:
        """Return the dynamics with the first moments of a gravity model."""
        inertias, rotors = identifiable(geometry)
        nominal = nominal_parameters(geometry, first_moments(model, geometry))
        carried = _with_minimum(mean_inertia(geometry, nominal))
        prior_std = np.concatenate([[np.inf], _INERTIA_STD * carried[inertias // 10],
                                    np.full(len(rotors), _ROTOR_STD * carried.max())])
        return cls(geometry, nominal, inertias, rotors, prior_std)

    def coefficients(self) -> Coefficients:
        return (NOMINAL, *(_inertia(k // 10, PARAMETERS[k % 10], ' beyond that of the nominal arm')
                           for k in map(int, self.inertias)), *map(_rotor, self.rotors))

    def columns(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        k = 1 + len(self.inertias)
        columns = np.zeros((*q.shape, k + len(self.rotors)))
        for start in range(0, len(q), _BATCH):
            rows = slice(start, start + _BATCH)
            every = regressor(self.geometry, q[rows], qd[rows], qdd[rows])
            columns[rows, :, 0] = every @ self.nominal
            columns[rows, :, 1:k] = every[:, :, self.inertias]
        for number, joint in enumerate(self.rotors):
            columns[:, joint, k + number] = qdd[:, joint]
        return columns


@dataclass(frozen=True, eq=False)
class ChainDynamics(Dynamics):
    """
    Dynamic torque of an arm with the axes and moments of a chain, and unknown lengths.

    `balls` (N,) in kg·m^2 are the inertias of the nominal arm (`motion_columns`). `n_vertical` is
    the number of vertical axes, whose moments gravity does not excite.
    """

    chain: Chain
    balls: FloatArray
    prior_std: FloatArray
    n_vertical: int

    @classmethod
    def of(cls, chain: Chain, n_vertical: int = 0) -> ChainDynamics:
        """Return the dynamics of a chain; nominal inertias are estimated from its moments."""
        n = chain.n_joints
        if n_vertical > 1:
            moments = chain.moments.copy()
            moments[:n_vertical] = 0.0
            chain = Chain(chain.axes, moments)
        balls = _with_minimum(_LENGTH * np.linalg.norm(chain.moments, axis=1) / STANDARD_GRAVITY)
        carried = np.cumsum(balls[::-1])[::-1]
        inertia_std = _INERTIA_STD * carried
        prior_std = np.concatenate([
            [np.inf], inertia_std[:1], np.repeat(inertia_std[1:], len(INERTIAS)),
            np.full(3 * (n - 1), _LENGTH_STD), np.full(n - 1, _ROTOR_STD * carried.max()),
            np.full(2 if n_vertical > 1 else 0, carried[1:2].sum())])
        return cls(chain, balls, prior_std, n_vertical)

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


def _with_minimum(carried: FloatArray) -> FloatArray:
    """Return inertias (N,) in kg·m^2 about each joint, limited from below."""
    return np.maximum(carried, max(_MIN_INERTIA * float(carried.max()), 1e-6))


def _inertia(link: int, kind: str, beyond: str = '') -> Coefficient:
    return Coefficient(f'{kind}_{link + 1}', 'kg·m^2',
                       f'{kind} of link number {link + 1}{beyond}, including its load')


def _length(joint: int, axis: str) -> Coefficient:
    return Coefficient(f'{axis}_{joint + 1}', 'm', f'position of axis {joint + 1} in link number '
                                                   f'{joint}, along {axis}')


def _product(joint: int, axis: str) -> Coefficient:
    return Coefficient(f'hp{axis}_{joint}', 'kg·m^2', f'moment about axis {joint} times the '
                                                      f'length to it, along {axis}')


def _rotor(joint: int) -> Coefficient:
    return Coefficient(f'J_{joint + 1}', 'kg·m^2', f'inertia of the rotor of joint number '
                                                   f'{joint + 1}, behind its gear')


@lru_cache(maxsize=4)
def described_dynamics(model: GravityModel) -> DescribedDynamics | None:
    """Return the dynamics of a gravity model with known axes; None without known axes."""
    return None if model.geometry is None else DescribedDynamics.of(model, model.geometry)


@lru_cache(maxsize=4)
def chain_dynamics(chain: Chain, signs: tuple[float, ...] = ()) -> ChainDynamics:
    """Return the dynamics of a chain with these signs of vertical axes."""
    return ChainDynamics.of(with_axis_signs(chain, signs), len(signs))


def axis_sign_options(chain: Chain, q: FloatArray) -> list[tuple[float, ...]]:
    """
    Return the possible signs of the vertical axes of a chain, which gravity does not determine.

    An axis without gravity torque is vertical in every pose: the first one of a level base, and
    the next ones parallel to it, as in a SCARA.

    :param q: (M, N) poses in rad.
    """
    count = 0
    if chain.n_joints > 1 and len(q) > 0 and is_level(chain.torque(q)):
        count, maximum = 1, min(chain.n_joints - 1, len(SIGN_SETTINGS))
        while count < maximum and abs(chain.axes[count][2, 2]) > _PARALLEL:
            count += 1
    return list(product((1.0, -1.0), repeat=count))


def axis_signs(chain: Chain, q: FloatArray) -> tuple[float, ...]:
    """Return the sign of each vertical axis of a chain, given poses q (M, N)."""
    return tuple(axis_sign(chain, axis) for axis in range(len(axis_sign_options(chain, q)[0])))


def with_axis_signs(chain: Chain, signs: tuple[float, ...]) -> Chain:
    """
    Return the chain with these signs (1 or -1) of its first axes.

    Gravity does not determine the sign of a vertical axis, since no height depends on its angle.
    Dynamics do, since they couple that joint to the others.
    """
    half_turn = np.diag([1.0, -1.0, -1.0])
    for joint, sign in enumerate(signs):
        if sign * axis_sign(chain, joint) >= 0.0:
            continue
        axes, moments = chain.axes.copy(), chain.moments.copy()
        axes[joint], axes[joint + 1] = axes[joint] @ half_turn, half_turn @ axes[joint + 1]
        moments[joint, 1] *= -1.0
        chain = Chain(axes, moments)
    return chain


def axis_sign(chain: Chain, vertical: int = 0) -> float:
    """
    Return the sign of a vertical axis: 1 or -1, or 0 if both describe the same arm.

    The mirror image of an arm has the same gravity and kinetic energy, and the opposite first
    axis. The sign is defined by a quantity that is invariant under reflection: the correlation of
    the angle between the vertical axis and the next axis that is not fixed to it with the gravity
    torque of the joint that moves that axis.
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
        if abs(common) > _MIN_CORRELATION * float(between.std()
                                                  * gravity[:, joint].std()) > 0.0:
            return float(np.sign(common))
    return 0.0


def _between(chain: Chain, q: FloatArray, vertical: int, joint: int) -> FloatArray:
    """Return the cosine (M,) of the angle between a vertical axis and that of a joint."""
    axes = ForwardKinematics(chain.axes, q).rotated[:, 2]
    return np.asarray((axes[vertical] * axes[joint]).sum(axis=0))


def first_moments(model: GravityModel, geometry: Geometry) -> FloatArray:
    """
    Return the first moments (N, 2) of a gravity model about known axes, in kg·m.

    They are those of its chain, or the least-squares fit to its torque over the trained range.
    """
    chain = model.chain
    if chain is not None and np.allclose(chain.axes[1:], geometry.rotations[1:], atol=1e-6):
        return chain.moments / STANDARD_GRAVITY
    low, high = model.coverage.q_min, model.coverage.q_max
    q = np.random.default_rng(0).uniform(low, np.maximum(high, low), (_POSES, model.n_joints))
    columns = ForwardKinematics(geometry.rotations, q).moment_columns()
    flat = columns.reshape(len(columns), -1).T
    moments = lstsq(flat, model.predict(q).T.ravel(), rcond=1e-6)
    return np.asarray(moments.reshape(-1, 2) / STANDARD_GRAVITY)
