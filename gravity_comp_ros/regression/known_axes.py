"""
Gravity and dynamics of an arm whose axes and lengths a robot description gives.

The torque is linear in the inertial parameters of the links (`models.kinematic.rigid_body`); the
base parameters are a maximal set of linearly independent columns (M. Gautier, W. Khalil, IEEE
Transactions on Robotics and Automation 6, 1990). The mounting of the base and the zero angles of
the joints are parameters as well, with a narrow prior. `with_exact_angles` compares each with the
angle of the description by their evidence (the ratio of Savage and Dickey).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.models.kinematic.arm_columns import (
    Basis, basis_of, described_columns, kept_parameters)
from gravity_comp_ros.models.kinematic.chain import about_z, Chain, ForwardKinematics, tilt
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.nominal_arm import nominal_parameters
from gravity_comp_ros.models.kinematic.rigid_body import inverse_dynamics, PARAMETERS
from gravity_comp_ros.regression.prior import Prior, Scale
from gravity_comp_ros.regression.shared import mixture_std, Shared, State
import numpy as np
from scipy.linalg import block_diag

# Singular value below which moments depend on others, as a share of the largest.
_INDEPENDENT = 1e-6
# Minimum size of a column, as a share of the largest.
_SMALL = 0.01
# Rotation in rad of a finite difference.
_DIFFERENCE = 1e-6


@dataclass(frozen=True)
class KnownPriors:
    """
    Priors of an arm with a description; standard deviations unless stated.

    `moment` of a first moment, as a multiple of the largest torque. The mean of the parameters is
    that of the nominal arm with the estimated moments (`models.kinematic.nominal_arm`).
    `inertia` is the share of a joint's dynamic torque by which one parameter of a link may change
    it, of large evidence on 14 arms with and without described masses; before the moments are
    known the torque is `unknown` in s^2 times the torque scale. `rotor` in s^2 times the joint's
    torque scale is the reflected inertia of a rotor.

    `tilt` in rad of the base and `zero` in rad of a zero angle: a base is levelled and encoders
    are set to within half a degree. `vertical` in rad is that of the tilts of a vertical that was
    estimated (`regression.vertical`); `exact` in rad is the rounding of an angle in a
    description, and `fixed` the standard deviation of one that is as described.
    """

    moment: float = 3.0
    inertia: float = 0.08
    unknown: float = 0.3
    rotor: float = 0.02
    tilt: float = 0.01
    vertical: float = 0.1
    zero: float = 0.01
    exact: float = 1e-4
    fixed: float = 1e-7


@dataclass(frozen=True, eq=False)
class KnownAxes(Shared):
    """
    An arm on the axes of a geometry: 2 tilts of the base, N zero angles, K base parameters.

    `values` (K,) are the base parameters. `geometry` is the `described` one changed by the angles
    `turned` (2 + N,), tilts and zeros; `is_exact` are those that are as described, with
    their `exact_std`. With
    `is_mounted` the described vertical is that of the arm, otherwise an estimate. `nominal`
    (10 N,) are the parameters of the nominal arm, 0 before the moments are estimated.
    """

    geometry: Geometry
    values: FloatArray
    described: Geometry
    turned: FloatArray
    is_exact: BoolArray
    mixture_std: FloatArray
    nominal: FloatArray
    is_mounted: bool = True
    priors: KnownPriors = KnownPriors()

    @classmethod
    def of(cls, geometry: Geometry, is_mounted: bool = True) -> KnownAxes:
        """Return an arm with all inertial parameters 0."""
        n, kept = geometry.n_joints, basis_of(geometry).kept
        geometry = replace(geometry, base=tuple(map(int, kept)))
        return cls(geometry, np.zeros(len(kept)), geometry, np.zeros(2 + n),
                   np.zeros(2 + n, dtype=bool), np.zeros(2 + n),
                   np.zeros(len(PARAMETERS) * n), is_mounted)

    @property
    def basis(self) -> Basis:
        return basis_of(self.described)

    @property
    def chain(self) -> Chain:
        """Return gravity as a chain on these axes."""
        moments = _moments_of(self.geometry) @ self.values
        return Chain(self.geometry.rotations, moments.reshape(-1, 2))

    @property
    def point(self) -> FloatArray:
        return np.concatenate([np.zeros(2 + self.geometry.n_joints), self.values])

    @property
    def n_angles(self) -> int:
        return 2 + self.geometry.n_joints

    def step_map(self) -> FloatArray:
        """
        Return the step of the chain per parameter, (4N, P).

        Both are tangents of the same gravity torques, compared at random poses.
        """
        n, q = self.geometry.n_joints, random_poses(self.geometry.n_joints)
        still = State(q, 0.0 * q, 0.0 * q)
        steps = self.chain.jacobian(q).transpose(2, 1, 0).reshape(-1, 4 * n)
        return _lstsq(steps, self.columns(still).reshape(len(steps), -1))

    def exact_std(self) -> FloatArray:
        return self.mixture_std

    def prior(self, scale: Scale) -> Prior:
        """
        Return the prior of the angles and base parameters.

        Of the base parameters, sums of the parameters of links, the moments are wide. The others
        follow them as in the normal distribution of the parameters about the nominal arm.
        """
        k, basis = self.n_angles, self.basis
        factor = basis.grouped * self._inertia_std(scale)
        own = _moments_of(self.described) @ factor
        following = factor @ np.linalg.pinv(own, rcond=_INDEPENDENT)
        factors = np.hstack([factor - following @ own,
                             self.priors.moment * scale.largest * following])
        angles = np.where(self.is_exact, self.priors.fixed, self._angle_std)
        root = block_diag(np.diag(angles), np.asarray(np.linalg.qr(factors.T, 'r')).T)
        return Prior(np.concatenate([np.zeros(k), basis.grouped @ self.nominal]), root)

    def _inertia_std(self, scale: Scale) -> FloatArray:
        """Return the standard deviations (10 N,) of the parameters about the nominal arm."""
        dynamic, rotor = self.basis.dynamic, self.priors.rotor * scale.torque
        nominal = _rms(dynamic @ self.nominal) if self.nominal.any() \
            else self.priors.unknown * scale.torque
        size = _rms(dynamic)                                                      # (N, 10 N)
        size = np.maximum(size, _SMALL * size.max(axis=1, keepdims=True))
        std = self.priors.inertia * (np.hypot(nominal, rotor)[:, None] / size).min(axis=0)
        std[PARAMETERS.index('Izz')::len(PARAMETERS)] += rotor
        return std

    def renewed(self) -> KnownAxes:
        return replace(self, nominal=nominal_parameters(
            self.geometry, self.chain.moments / STANDARD_GRAVITY))

    @property
    def _angle_std(self) -> FloatArray:
        p = self.priors
        tilt_std = p.tilt if self.is_mounted else p.vertical
        return np.concatenate([np.full(2, tilt_std), np.full(self.geometry.n_joints, p.zero)])

    def columns(self, state: State) -> FloatArray:
        n, chain = self.geometry.n_joints, self.chain
        angles = np.zeros((len(state.q), n, 2 + n))
        if self.values.any():
            angles[:, :, :2] = ForwardKinematics(chain.axes, state.q).axis_columns(
                chain.moments)[:2].transpose(2, 1, 0)
            angles[:, :, 2:] = self._by_zero_angles(state)
        return np.concatenate([angles, described_columns(
            self.geometry, state.q, state.qd, state.qdd)], axis=2)

    def _by_zero_angles(self, state: State) -> FloatArray:
        """Return d torque / d zero angles (B, N, N) by differences; motion is part of it."""
        n, torque = state.q.shape[1], self.torque(state)
        result = np.empty((len(state.q), n, n))
        for joint in range(n):
            q = state.q.copy()
            q[:, joint] += _DIFFERENCE
            result[:, :, joint] = (
                self.torque(State(q, state.qd, state.qdd)) - torque) / _DIFFERENCE
        return result

    def torque(self, state: State) -> FloatArray:
        parameters = np.zeros(10 * self.geometry.n_joints)
        parameters[kept_parameters(self.geometry)] = self.values
        return inverse_dynamics(self.geometry, state.q, state.qd, state.qdd, parameters,
                                STANDARD_GRAVITY)

    def gravity(self, q: FloatArray) -> FloatArray:
        return self.chain.torque(q)

    def gradient(self, q: FloatArray) -> FloatArray:
        return self.chain.gradient(q)

    def moved(self, parameters: FloatArray) -> KnownAxes:
        n = self.n_angles
        return replace(self, geometry=_turned(self.geometry, parameters[:n]),
                       turned=self.turned + parameters[:n], values=parameters[n:])

    def with_exact_angles(self, covariance: FloatArray) -> KnownAxes:
        variance = np.diag(covariance)[:self.n_angles] + self.priors.exact ** 2
        gain = np.log(self._angle_std / np.sqrt(variance)) - 0.5 * self.turned ** 2 / variance
        if not self.is_mounted:
            gain[:2] = -np.inf
        is_exact = self.is_exact | (gain > 0.0)
        if np.array_equal(is_exact, self.is_exact):
            return self
        exact = self._with_exact(is_exact)
        std = np.where(self.is_exact, self.mixture_std,
                       mixture_std(gain, self.turned, variance))
        return replace(exact, mixture_std=np.where(exact.is_exact, std, 0.0))

    def at_near_angles(self) -> KnownAxes:
        """Return the same with all angles as described, but those of an estimated vertical."""
        return self._with_exact(
            self.is_exact | (np.arange(self.n_angles) >= (0 if self.is_mounted else 2)))

    def _with_exact(self, is_exact: BoolArray) -> KnownAxes:
        """Return the same with some angles (2 + N,) as described."""
        turned = np.where(is_exact, 0.0, self.turned)
        return replace(self, geometry=_turned(self.described, turned), turned=turned,
                       is_exact=is_exact)


def _moments_of(geometry: Geometry) -> FloatArray:
    """Return the chain's moments per base parameter, (2N, K)."""
    return geometry.moments()[:, kept_parameters(geometry)]


def _turned(geometry: Geometry, angles: FloatArray) -> Geometry:
    """Return a geometry after two tilts of the base and N changes of zero angles."""
    zero = angles[2:]
    rotations = geometry.rotations @ about_z(zero)
    rotations[0] = geometry.rotations[0] @ tilt(angles[None, :2])[0] @ about_z(zero[:1])[0]
    return replace(geometry, rotations=rotations)


def _rms(torque: FloatArray) -> FloatArray:
    """Return the RMS over states of torques (B, ...)."""
    return np.asarray(np.sqrt((torque ** 2).mean(axis=0)))


def _lstsq(columns: FloatArray, target: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(columns, target, rcond=1e-9)[0])
