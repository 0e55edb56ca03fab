"""
Joint fit of gravity, friction, offset and dynamics of all joints.

It is a ridge regression: each coefficient has a prior standard deviation, which is weighed against
the effective number of samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.arm_dynamics import Dynamics
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Prior standard deviation of the tilt of axes, in rad.
_TILT = 0.3
# Prior standard deviation of friction and an offset, as a share of the RMS torque of the joint,
# and minimum of that torque, as a share of the largest. Where the motion does not distinguish them
# from gravity, gravity has the torque.
_PRIOR_FRICTION, _MIN_RELATIVE_TORQUE = 0.2, 0.1
# Iterations of the weights of joints by their residual.
_ROUNDS = 3
# Effective number of autocorrelated samples: per second, minimum, and maximum against a prior
# (model errors do not average out in a long recording).
_PER_SECOND, _MIN_COUNT, _MAX_COUNT = 2.0, 10.0, 120.0
_FOLDS = 5
# Minimum mean squared error, relative to the largest squared torque.
_MIN_ERROR = 1e-12


@dataclass(frozen=True, eq=False)
class MotionFit:
    """
    Result: coefficients (K,) of the dynamics, and torques (M, N) in N·m.

    `nuisance` is the torque of friction, offset and dynamics, `residual` that of the whole fit.
    """

    dynamics: FloatArray
    nuisance: FloatArray
    residual: FloatArray


@dataclass(frozen=True, eq=False)
class MotionProblem:
    """
    Columns x (M, N, K) of gravity, dynamics and friction, and torque `tau` (M, N) in N·m.

    `prior_std` (K,) are prior standard deviations. Columns `dynamic` are those of the dynamics.
    `samples_per_observation` is the number of samples per effective sample.
    """

    x: FloatArray
    tau: FloatArray
    prior_std: FloatArray
    dynamic: slice
    samples_per_observation: float

    @classmethod
    def of(cls, gravity: FloatArray, n_tilts: int, motion: Motion,
           dynamics: Dynamics) -> MotionProblem:
        """
        Return the problem of a motion.

        :param gravity: (M, N, K) columns of gravity, the first `n_tilts` by tilts of axes, the
            others by first moments.
        """
        samples = motion.samples
        m, n = samples.q.shape
        k = gravity.shape[2]
        x = np.concatenate([gravity, dynamics.columns(samples.q, samples.qd, motion.qdd),
                            *(_on_joint(j, n, friction(motion, j)) for j in range(n))], axis=2)
        prior_std, dynamic = np.full(x.shape[2], np.inf), slice(k, k + len(dynamics.prior_std))
        prior_std[:n_tilts], prior_std[n_tilts:k] = _TILT, float(np.abs(samples.tau).max())
        prior_std[dynamic] = dynamics.prior_std
        prior_std[dynamic.stop:] = friction_prior_std(samples).ravel()
        return cls(x, samples.tau, prior_std, dynamic, samples_per_observation(samples))

    def fit(self, share: float = 1.0) -> MotionFit:
        """
        Return the fit to all samples.

        :param share: factor of the prior standard deviations of the dynamics.
        """
        x, residual = self._weighted_fit(share)
        k = self.dynamic.start
        return MotionFit(x[self.dynamic], self.x[:, :, k:] @ x[k:], residual)

    def held_out_errors(self, shares: Sequence[float]) -> FloatArray:
        """
        Return the cross-validation error for each share, (S,).

        It is the mean over joints of the logarithm of the mean squared error, which is comparable
        between problems with different columns.
        """
        m, n, _ = self.x.shape
        weight = _weight(self._weighted_fit(1.0)[1])
        products = [_weighted(*part, weight) for part in zip(*self._products)]
        gram, right = (np.sum(list(each), axis=0) for each in zip(*products))
        errors = np.zeros((len(shares), n))
        for part, (part_gram, part_right) in zip(self._parts, products):
            for number, share in enumerate(shares):
                fit = _ridge(gram - part_gram, right - part_right, self._prior(share))
                errors[number] += ((self.tau[part] - self.x[part] @ fit) ** 2).sum(axis=0)
        minimum = max(_MIN_ERROR * float((self.tau ** 2).max(initial=0.0)), 1e-24)
        return np.asarray(np.log(np.maximum(errors / m, minimum)).mean(axis=1))

    def _prior(self, share: float) -> FloatArray:
        """Return the prior information (K,) in samples of unit weight."""
        prior_std = self.prior_std.copy()
        prior_std[self.dynamic] *= share
        return np.asarray(prior_std ** -2.0 * self.samples_per_observation)

    def _weighted_fit(self, share: float) -> tuple[FloatArray, FloatArray]:
        """Return coefficients (K,) and the residual (M, N), weighted by residual per joint."""
        prior, residual = self._prior(share), self.tau
        gram, right = (each.sum(axis=0) for each in self._products)
        for _ in range(_ROUNDS):
            x = _ridge(*_weighted(gram, right, _weight(residual)), prior)
            residual = self.tau - self.x @ x
        return x, residual

    @property
    def _parts(self) -> list[slice]:
        """Return the samples of each fold."""
        ends = np.linspace(0, len(self.tau), _FOLDS + 1).astype(int).tolist()
        return [slice(start, end) for start, end in zip(ends, ends[1:])]

    @cached_property
    def _products(self) -> tuple[FloatArray, FloatArray]:
        """Return the products (F, N, K, K) and (F, N, K) of each fold and joint."""
        x, y = self.x.transpose(1, 0, 2), self.tau.T[:, None]
        return (np.stack([x[:, part].transpose(0, 2, 1) @ x[:, part] for part in self._parts]),
                np.stack([(y[:, :, part] @ x[:, part])[:, 0] for part in self._parts]))


def _weighted(gram: FloatArray, right: FloatArray,
              weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the sums over joints of products (N, K, K) and (N, K), weighted by (N,)."""
    return (np.einsum('n,nij->ij', weight ** 2, gram), weight ** 2 @ right)


def _weight(residual: FloatArray) -> FloatArray:
    """Return the weight (N,) of each joint, the inverse standard deviation of its residual."""
    std = residual.std(axis=0)
    return np.asarray(1.0 / np.maximum(std, max(1e-6 * float(std.max()), 1e-12)))


def _ridge(gram: FloatArray, right: FloatArray, prior: FloatArray) -> FloatArray:
    """Return the coefficients; directions without data and prior are 0."""
    gram = gram + np.diag(prior)
    size = np.sqrt(np.maximum(np.diag(gram), 1e-24))
    inverse = np.linalg.pinv(gram / np.outer(size, size), rcond=1e-13, hermitian=True)
    return np.asarray(inverse @ (right / size) / size)


def friction(motion: Motion, joint: int) -> FloatArray:
    """Return the columns (M, 3) of Coulomb and viscous friction and an offset."""
    qd = motion.samples.qd[:, joint]
    return np.column_stack([motion.direction(joint), qd, np.ones(len(qd))])


def friction_prior_std(samples: JointSamples) -> FloatArray:
    """Return the prior standard deviations (N, 3) of the coefficients of `friction`."""
    torque = np.sqrt((samples.tau ** 2).mean(axis=0))
    torque = np.maximum(torque, max(_MIN_RELATIVE_TORQUE * float(torque.max()), 1e-9))
    speed = np.maximum(np.sqrt((samples.qd ** 2).mean(axis=0)), 1e-9)
    size = _PRIOR_FRICTION * torque
    return np.column_stack([size, size / speed, size])


def effective_count(samples: JointSamples) -> float:
    """Return the effective number of autocorrelated samples, by the duration that they cover."""
    duration = sum(float(np.ptp(samples.t[run])) for run in run_slices(samples))
    return float(min(max(_PER_SECOND * duration, _MIN_COUNT), max(len(samples), 1)))


def samples_per_observation(samples: JointSamples) -> float:
    """Return the number of samples per effective sample, for the weight of a prior."""
    return len(samples) / min(effective_count(samples), _MAX_COUNT)


def _on_joint(joint: int, n: int, columns: FloatArray) -> FloatArray:
    """Return columns (M, K) of one joint as columns of all joints, (M, N, K)."""
    whole = np.zeros((len(columns), n, columns.shape[1]))
    whole[:, joint] = columns
    return whole
