"""
Estimation of the vertical of an arm with known axes: mounted on a wall, an incline or a ceiling.

A robot description is usually upright, whatever the mounting of the real arm. The torque is linear
in the moments and linear in the three components of the vertical, so one set of sums of products
serves all verticals. They are evaluated on a grid over half of the sphere and then refined. The
other half has the same torques with negated moments: there the masses of a nominal arm decide,
which are not negative.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics, skew
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.nominal_arm import unreachable_share
import numpy as np

# Number of samples used, and their assumed autocorrelation time in samples.
_SAMPLES, _CORRELATION_TIME = 150, 4.0
# Verticals on half of the sphere, about 13 degrees apart, and the number that is refined.
_GRID, _REFINED = 128, 4
# Largest base tilt, in rad, that the fit of the moments corrects without this search.
MAX_FITTED_TILT = np.radians(20.0)
# First and last step of a refinement, in rad.
_FIRST_STEP, _LAST_STEP = np.radians(8.0), np.radians(0.2)
# Another vertical must reduce some joint's RMSE by this share, and exceed this log-likelihood
# ratio: an unmodelled effect is partly collinear with a rotation of the base as well.
_MIN_REDUCTION, _MIN_LOG_LIKELIHOOD = 0.3, 12.0
# Damping of directions that the motion hardly excites, as a share of the mean excitation.
_DAMPING = 1e-4
# Minimum torque of a joint, as a share of the largest.
_MIN_TORQUE = 1e-2
# The arm is mounted upside down if that lowers the share of moments that non-negative masses do
# not reach below this multiple. The share of three real arms is 1 to 8 %, and 72 to 99 % when
# inverted; of randomly drawn arms 10 to 30 % and 30 to 80 %. Of 216 simulated recordings on a
# floor 2 are inverted, of 162 on a ceiling 30 are not (bench/vertical.py).
_INVERTED = 0.7
# Error of the moments of a nominal arm, as a share of the largest torque.
_NOMINAL_ERROR = 0.05
_UP = np.array([0.0, 0.0, 1.0])


def with_estimated_vertical(geometry: Geometry, samples: JointSamples,
                            noise: FloatArray | None = None) -> Geometry:
    """
    Return the geometry with the estimated vertical, unchanged if the described one is close.

    :param geometry: the axes of the samples' joints, in their order.
    :param noise: standard deviation (N,) in N·m of torques that a model predicts, which do not
        contain it (default: the torques are measured).
    """
    if geometry.n_joints < 2:
        return geometry
    torques = _Torques.of(geometry, samples,
                          np.zeros(geometry.n_joints) if noise is None else noise)
    vertical = torques.best()
    moments, weights = torques.moments(vertical)
    moments = moments / STANDARD_GRAVITY
    rotated = replace(geometry, rotations=_rotated(geometry.rotations, vertical))
    inverted = replace(geometry, rotations=_rotated(geometry.rotations, -vertical))
    if (unreachable_share(inverted, -moments, weights)
            < _INVERTED * unreachable_share(rotated, moments, weights)):
        return inverted
    return rotated if vertical[2] < np.cos(MAX_FITTED_TILT) else geometry


def base_tilt_angle(rotations: FloatArray, others: FloatArray) -> float:
    """Return the angle in rad between the verticals of two arms, from their axes (N, 3, 3)."""
    one, other = rotations[0][2], others[0][2]
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


@dataclass(frozen=True, eq=False)
class _Torques:
    """
    Normal equations of each joint's torque, for any vertical.

    `products` (N, C, C), `right` (N, C) and `squares` (N,); `largest` is the largest torque in
    N·m. `noise` (N,) are squares that every sum of squared residuals contains. The columns C are
    2 N moments for a vertical along each of the base's axes, then an offset and Coulomb friction
    of each joint.
    """

    products: FloatArray
    right: FloatArray
    squares: FloatArray
    noise: FloatArray
    n_samples: int
    largest: float

    @classmethod
    def of(cls, geometry: Geometry, samples: JointSamples, noise: FloatArray) -> _Torques:
        rows, n = evenly_picked(samples.n_samples, _SAMPLES), samples.n_joints
        q, tau = samples.q[rows], samples.tau[rows]
        kinematics = ForwardKinematics(geometry.rotations, q)
        nuisance = np.zeros((2 * n, n, len(q)))
        for joint in range(n):
            nuisance[2 * joint, joint] = 1.0
            nuisance[2 * joint + 1, joint] = np.sign(samples.qd[rows, joint])
        columns = np.concatenate([*(kinematics.moment_columns(axis) for axis in range(3)),
                                  nuisance]).transpose(1, 0, 2)
        return cls(columns @ columns.transpose(0, 2, 1), np.einsum('ncm,mn->nc', columns, tau),
                   (tau ** 2).sum(axis=0), len(q) * noise ** 2, len(q),
                   float(np.abs(tau).max()))

    def best(self) -> FloatArray:
        """Return the vertical (3,) in the base; near z unless another is much more probable."""
        # Weighted by residuals, so that a noisy joint does not dominate the others.
        weights = self._weights(self._residual(_UP[None], self._torque_weights())[0])
        described = self._residual(_UP[None], weights)[0]
        near = self._refined(_UP, weights, MAX_FITTED_TILT)
        residual = self._residual(near[None], weights)[0]
        if not self._is_more_probable(residual, described):
            # At a nearly vertical first axis its moments are not identifiable.
            near, residual = _UP, described
        weights = self._weights(residual)
        grid = _half_sphere()
        cost = (self._residual(grid, weights) * weights).sum(axis=1)
        ends = [self._refined(grid[k], weights) for k in np.argsort(cost)[:_REFINED]]
        residuals = self._residual(np.array(ends), weights)
        first = int((residuals * weights).sum(axis=1).argmin())
        best = ends[first]
        is_far = best[2] < np.cos(MAX_FITTED_TILT)
        return best if is_far and self._is_more_probable(residuals[first], residual) else near

    def _is_more_probable(self, residual: FloatArray, before: FloatArray) -> bool:
        """Return whether squared residuals (N,) are significantly smaller than before."""
        ratio = np.log(self._weights(before) / self._weights(residual))
        gain = -0.5 * self.n_samples / _CORRELATION_TIME * float(ratio.sum())
        return (gain > _MIN_LOG_LIKELIHOOD
                and 0.5 * float(ratio.min()) < np.log(1.0 - _MIN_REDUCTION))

    def moments(self, vertical: FloatArray) -> tuple[FloatArray, FloatArray]:
        """
        Return the best-fitting moments (N, 2) in N·m for a vertical (3,), and their weights.

        The weights (2 N, 2 N) are 1 for moments that the motion identifies better than a nominal
        arm can reproduce them, and 0 for those that it does not excite.
        """
        n = len(self.squares)
        residual = self._residual(vertical[None], self._torque_weights())[0]
        weights = self.n_samples / _CORRELATION_TIME * self._weights(residual)
        coefficients, products, _ = self._solved(vertical[None], self._torque_weights())
        gram = np.tensordot(weights, products[:, 0], axes=1)
        cross = gram[:2 * n, 2 * n:]
        information = gram[:2 * n, :2 * n] - cross @ np.linalg.pinv(
            gram[2 * n:, 2 * n:], rcond=1e-9, hermitian=True) @ cross.T
        values, vectors = np.linalg.eigh(information)
        values = np.maximum(values, 0.0) * self.largest ** 2 * _NOMINAL_ERROR ** 2
        identified = (vectors * np.sqrt(values / (1.0 + values))) @ vectors.T
        return coefficients[0, :2 * n].reshape(n, 2), np.asarray(identified)

    def _torque_weights(self) -> FloatArray:
        """Return the weight of each joint (N,): one over its sum of squared torques."""
        squares = self.squares + self.noise
        return np.asarray(1.0 / np.maximum(squares, _MIN_TORQUE ** 2 * squares.max()))

    def _weights(self, residual: FloatArray) -> FloatArray:
        """Return the weight of each joint (N,): one over its sum of squared residuals."""
        return np.asarray(1.0 / np.maximum(residual, 1e-9 * self.squares.max() + 1e-12))

    def _refined(self, start: FloatArray, weights: FloatArray,
                 reach: float = np.pi) -> FloatArray:
        """Return the local optimum (3,) of a pattern search, within `reach` rad of the start."""
        best, step = start, _FIRST_STEP
        lowest = float((self._residual(best[None], weights) * weights).sum())
        while step > _LAST_STEP:
            around = _around(best, step)
            around = around[around @ start > np.cos(reach) + 1e-9]
            cost = (self._residual(around, weights) * weights).sum(axis=1)
            if cost.size and cost.min() < lowest:
                best, lowest = around[cost.argmin()], float(cost.min())
            else:
                step *= 0.5
        return best

    def _residual(self, verticals: FloatArray, weights: FloatArray) -> FloatArray:
        """Return each joint's sum of squared residuals (V, N) for verticals (V, 3)."""
        x, products, right = self._solved(verticals, weights)
        inner = np.einsum('vc,nvc->vn', x, 2.0 * right)
        quadratic = np.einsum('vc,nvcd,vd->vn', x, products, x)
        return np.asarray(np.maximum(self.squares - inner + quadratic, 0.0) + self.noise)

    def _solved(self, verticals: FloatArray, weights: FloatArray
                ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return moments and nuisance coefficients (V, 2 N + K), and `_for_verticals`."""
        products, right = self._for_verticals(verticals)
        gram = np.tensordot(weights, products, axes=1)
        target = np.tensordot(weights, right, axes=1)
        size = np.trace(gram, axis1=1, axis2=2) / gram.shape[1]
        damped = gram + (_DAMPING ** 2 * size)[:, None, None] * np.eye(gram.shape[1])
        return np.linalg.solve(damped, target[:, :, None])[:, :, 0], products, right

    def _for_verticals(self, verticals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return products (N, V, C, C) and right sides (N, V, C) for verticals (V, 3)."""
        n = len(self.squares)
        split = 6 * n
        gravity = self.products[:, :split, :split].reshape(n, 3, 2 * n, 3, 2 * n)
        cross = self.products[:, :split, split:].reshape(n, 3, 2 * n, -1)
        nuisance = self.products[:, split:, split:]
        v = len(verticals)
        top = np.einsum('va,nacbd,vb->nvcd', verticals, gravity, verticals, optimize=True)
        side = np.einsum('va,nack->nvck', verticals, cross)
        corner = np.broadcast_to(nuisance[:, None], (n, v, *nuisance.shape[1:]))
        products = np.concatenate([
            np.concatenate([top, side], axis=3),
            np.concatenate([side.transpose(0, 1, 3, 2), corner], axis=3)], axis=2)
        right = np.concatenate([
            np.einsum('va,nac->nvc', verticals, self.right[:, :split].reshape(n, 3, 2 * n)),
            np.broadcast_to(self.right[:, None, split:], (n, v, 2 * n))], axis=2)
        return products, right


def _half_sphere() -> FloatArray:
    """Return verticals (V, 3), evenly spread over the upper half: a golden-angle spiral."""
    z = 1.0 - (np.arange(_GRID) + 0.5) / _GRID
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_GRID)
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


def _around(vertical: FloatArray, step: float) -> FloatArray:
    """Return six verticals (6, 3) at an angle from one."""
    side = np.cross(vertical, np.eye(3)[np.abs(vertical).argmin()])
    side /= np.linalg.norm(side)
    other = np.cross(vertical, side)
    angle = np.pi / 3.0 * np.arange(6)[:, None]
    around = np.cos(angle) * side + np.sin(angle) * other
    return np.asarray(np.cos(step) * vertical + np.sin(step) * around)


def _rotated(rotations: FloatArray, vertical: FloatArray) -> FloatArray:
    """Return the axes (N, 3, 3) with the base rotated so that `vertical` becomes its z axis."""
    result = rotations.copy()
    if vertical[2] < -1.0 + 1e-12:
        result[0] = np.diag([1.0, -1.0, -1.0]) @ rotations[0]
        return result
    cross = skew(np.cross(vertical, _UP))
    result[0] = (np.eye(3) + cross + cross @ cross / (1.0 + vertical[2])) @ rotations[0]
    return result
