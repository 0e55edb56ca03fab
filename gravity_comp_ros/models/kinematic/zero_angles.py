"""
Zero-angle offsets between encoders and robot description, for an arm with known axes.

A misadjusted encoder zero is about a degree off, and a degree at the elbow changes the torque of
the shoulder by percents. With zero-angle offsets d the torque of a chain is tau(q + d), so a
small change of d adds d tau / d q. Only inner joints are identifiable: gravity has no torque about
a vertical first axis, and an offset of the last joint only rotates the moments of its own link. A
base tilt has a similar, smaller effect on all torques and is fitted jointly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.models.kinematic.chain import about_z, ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.models.noise import correlation_times
import numpy as np

# Minimum autocorrelation time, in samples, and maximum effective sample size: more samples reduce
# the noise, but not the errors of the description and of the nuisance terms.
_MIN_CORRELATION_TIME, _MAX_EFFECTIVE_SAMPLES = 2.0, 125.0
# Prior standard deviation of an offset and largest accepted offset, in rad.
_PRIOR_STD, _MAX_OFFSET = np.radians(1.5), np.radians(15.0)
# Log evidence that offsets must gain over none.
_MIN_LOG_EVIDENCE = 6.0
# Maximum number of Gauss-Newton steps, and the step in rad at which they have converged.
_MAX_STEPS, _CONVERGED = 10, 1e-5
# Residuals beyond this multiple of their RMS are outliers.
_OUTLIER = 4.0
# Step of a numerical derivative, in rad.
_STEP = 1e-4
# Minimum residual of a joint, as a share of the largest torque.
_MIN_RESIDUAL = 1e-4
# Two axes are parallel up to this difference (1 minus the cosine).
_PARALLEL = 1e-9
# Singular values below this share of the largest are truncated: not excited by the motion.
_RCOND = 1e-4


def with_zero_angles(geometry: Geometry, samples: JointSamples) -> Geometry:
    """
    Return the geometry corrected by significant zero-angle offsets, unchanged without any.

    :param geometry: the axes of the samples' joints, in their order.
    :param samples: some hundred are enough.
    """
    if geometry.n_joints < 3 or not samples.tau.any():
        return geometry
    offsets, log_evidence = _Problem.of(geometry, samples).solve()
    if log_evidence < _MIN_LOG_EVIDENCE or np.abs(offsets).max() > _MAX_OFFSET:
        return geometry
    return replace(geometry, rotations=geometry.rotations @ about_z(offsets))


def same_axes(geometry: Geometry, other: Geometry) -> bool:
    """Return whether two geometries differ at most in base tilt and zero angles."""
    if geometry.joints != other.joints:
        return False
    cosines = np.einsum('nji,njk->nik', geometry.rotations, other.rotations)[1:, 2, 2]
    return bool((cosines > 1.0 - _PARALLEL).all())


def zero_angle_differences(rotations: FloatArray, others: FloatArray) -> FloatArray:
    """Return the zero angles (N,) in rad of `others` relative to `rotations`; both (N, 3, 3)."""
    relative = rotations.transpose(0, 2, 1) @ others
    return np.asarray(np.arctan2(relative[:, 1, 0], relative[:, 0, 0]))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Poses `q` (M, N), torques `tau` (M, N), and `nuisance` columns (K, N, M)."""

    rotations: FloatArray
    q: FloatArray
    tau: FloatArray
    nuisance: FloatArray
    runs: IntArray

    @classmethod
    def of(cls, geometry: Geometry, samples: JointSamples) -> _Problem:
        """Return the problem with offset, Coulomb and viscous friction of each joint."""
        qd, each = samples.qd.T, np.eye(samples.n_joints)[:, :, None]
        nuisance = np.concatenate([each * np.ones_like(qd), each * np.sign(qd), each * qd])
        return cls(geometry.rotations, samples.q, samples.tau, nuisance, samples.runs)

    def solve(self) -> tuple[FloatArray, float]:
        """Return the most probable offsets (N,) in rad, and their log evidence over none."""
        n = self.q.shape[1]
        offsets, inner, up = np.zeros(n), np.arange(1, n - 1), np.array([0.0, 0.0, 1.0])
        columns = np.concatenate([self._moment_columns(offsets)[2], self.nuisance])
        coefficients = self._linear_fit(columns, self._initial_weights())
        weights = self._weights(self._residual(columns, coefficients))
        for _ in range(_MAX_STEPS):
            columns = self._columns(offsets, up, coefficients[:2 * n])
            coefficients = self._linear_fit(columns, weights)
            derivatives = np.stack([self._derivative(offsets, up, joint, coefficients[:2 * n])
                                    for joint in inner])
            step = self._step(columns, derivatives, weights, offsets[inner])
            offsets[inner] += step
            up = up + [*coefficients[-2:], 0.0]
            residual = self._residual(columns, coefficients)
            weights = self._weights(residual)
            if np.abs(step).max() < _CONVERGED:
                break
        weights = self._reduced_if_autocorrelated(weights, residual)
        return offsets, self._log_evidence(columns, derivatives, weights, offsets[inner])

    def _initial_weights(self) -> FloatArray:
        size = self.tau.std(axis=0)
        return np.ones(self.tau.shape) / np.maximum(size, 1e-2 * size.max() + 1e-12)

    def _weights(self, residual: FloatArray) -> FloatArray:
        """Return the weights (M, N), one over each joint's residual RMS; 0 for outliers."""
        inside = np.abs(residual) <= _OUTLIER * np.sqrt((residual ** 2).mean(axis=0))
        rms = np.sqrt((residual ** 2 * inside).sum(axis=0) / np.maximum(inside.sum(axis=0), 1))
        floor = _MIN_RESIDUAL * np.abs(self.tau).max()
        return np.asarray(inside / (np.sqrt(self._variance_inflation()) * np.maximum(rms, floor)))

    def _variance_inflation(self) -> float:
        return max(_MIN_CORRELATION_TIME, len(self.q) / _MAX_EFFECTIVE_SAMPLES)

    def _reduced_if_autocorrelated(self, weights: FloatArray, residual: FloatArray) -> FloatArray:
        """Return smaller weights (M, N) for autocorrelated residuals: an effect is unmodelled."""
        excess = correlation_times(residual, self.runs) / self._variance_inflation()
        return np.asarray(weights / np.sqrt(np.maximum(excess, 1.0)))

    def _linear_fit(self, columns: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the coefficients of moments and nuisance columns at fixed offsets."""
        return lstsq(_rows(columns, weights).T, (self.tau * weights).T.ravel(), rcond=_RCOND)

    def _step(self, columns: FloatArray, derivatives: FloatArray, weights: FloatArray,
              offsets: FloatArray) -> FloatArray:
        """Return a Gauss-Newton step (F,) of the offsets, whose prior mean is 0."""
        d, residual = self._projected(columns, derivatives, weights)
        return np.asarray(np.linalg.solve(d @ d.T + np.eye(len(d)) / _PRIOR_STD ** 2,
                                          d @ residual - offsets / _PRIOR_STD ** 2))

    def _projected(self, columns: FloatArray, derivatives: FloatArray, weights: FloatArray
                   ) -> tuple[FloatArray, FloatArray]:
        """Return rows of the offsets (F, N M) and torque (N M,), orthogonal to all columns."""
        rows = _rows(columns, weights)
        projected = _rows(np.concatenate([derivatives, self.tau.T[None]]), weights)
        projected = projected - (rows.T @ lstsq(rows.T, projected.T, rcond=_RCOND)).T
        return projected[:-1], projected[-1]

    def _log_evidence(self, columns: FloatArray, derivatives: FloatArray, weights: FloatArray,
                      offsets: FloatArray) -> float:
        """Return the log evidence of the offsets over none, the torque linearised in them."""
        d, residual = self._projected(columns, derivatives, weights)
        without = residual + offsets @ d
        spread = np.eye(len(d)) + _PRIOR_STD ** 2 * d @ d.T
        gain = without @ without - residual @ residual - offsets @ offsets / _PRIOR_STD ** 2
        return float(0.5 * (gain - np.linalg.slogdet(spread)[1]))

    def _residual(self, columns: FloatArray, coefficients: FloatArray) -> FloatArray:
        return np.asarray(self.tau - np.tensordot(coefficients, columns, axes=(0, 0)).T)

    def _moment_columns(self, offsets: FloatArray) -> FloatArray:
        """Return the torque (3, 2N, N, M) per moment for a vertical along each base axis."""
        kinematics = ForwardKinematics(self.rotations, self.q + offsets)
        return np.stack([kinematics.moment_columns(axis) for axis in range(3)])

    def _columns(self, offsets: FloatArray, up: FloatArray, moments: FloatArray) -> FloatArray:
        """Return columns (C, N, M) of moments, nuisance terms, and the vertical's x and y."""
        per_axis = self._moment_columns(offsets)
        tilts = np.tensordot(moments, per_axis[:2], axes=(0, 1))
        return np.concatenate([np.tensordot(up, per_axis, axes=1), self.nuisance, tilts])

    def _derivative(self, offsets: FloatArray, up: FloatArray, joint: int, moments: FloatArray
                    ) -> FloatArray:
        """Return d torque / d offset (N, M) of one joint, by central differences."""
        step = _STEP * np.eye(len(offsets))[joint]
        ahead, behind = (
            np.tensordot(np.outer(up, moments), self._moment_columns(offsets + sign * step),
                         axes=2)
            for sign in (1.0, -1.0))
        return np.asarray((ahead - behind) / (2.0 * _STEP))


def _rows(columns: FloatArray, weights: FloatArray) -> FloatArray:
    """Return columns (K, N, M) times weights (M, N), as rows (K, N M)."""
    return np.asarray((columns * weights.T).reshape(len(columns), -1))
