"""
Gravity, friction, offset and the torque of motion of all joints, fitted together.

It is a ridge regression: each coefficient has a standard deviation before any data, and so many
samples as are independent speak against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.arm_dynamics import Dynamics
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# What is usual of gravity: tilts of axes in rad.
_TILT = 0.3
# Rounds in which joints get the weight of their residual.
_ROUNDS = 3
# Neighbouring samples are alike: so many a second count as independent, and no fewer in all. No
# more count against a prior: what a model lacks is alike in all of a long recording.
_INDEPENDENT, _FEWEST, _MOST = 2.0, 10.0, 120.0
_FOLDS = 5
# No joint is explained better than to this share of the largest squared torque.
_LEAST = 1e-12


@dataclass(frozen=True, eq=False)
class MotionFit:
    """
    What was found: coefficients (K,) of the dynamics, and torques (M, N) in N·m.

    `beside` is the torque of friction, offset and motion, `residual` what gravity leaves as well.
    """

    dynamics: FloatArray
    beside: FloatArray
    residual: FloatArray


@dataclass(frozen=True, eq=False)
class MotionProblem:
    """
    Columns x (M, N, K) of gravity, motion and friction, `tau` (M, N) in N·m, and usual sizes (K,).

    Columns number `dynamic` are those of the dynamics; `samples_per_observation` count as an independent one.
    """

    x: FloatArray
    tau: FloatArray
    usual: FloatArray
    dynamic: slice
    samples_per_observation: float

    @classmethod
    def of(cls, gravity: FloatArray, n_tilts: int, motion: Motion,
           dynamics: Dynamics) -> MotionProblem:
        """
        Return the problem of a motion.

        :param gravity: (M, N, K) columns of gravity; the first `n_tilts` are those of axes, the
            others those of moments.
        """
        samples = motion.samples
        m, n = samples.q.shape
        k = gravity.shape[2]
        x = np.concatenate([gravity, dynamics.columns(samples.q, samples.qd, motion.qdd),
                            *(_on_joint(j, n, friction(motion, j)) for j in range(n))], axis=2)
        usual, dynamic = np.full(x.shape[2], np.inf), slice(k, k + len(dynamics.usual))
        usual[:n_tilts], usual[n_tilts:k] = _TILT, float(np.abs(samples.tau).max())
        usual[dynamic] = dynamics.usual
        return cls(x, samples.tau, usual, dynamic, samples_per_observation(samples))

    def fit(self, share: float = 1.0) -> MotionFit:
        """
        Return the fit to all samples.

        :param share: of the usual sizes of the coefficients of the dynamics.
        """
        found, residual = self._settled(share)
        k = self.dynamic.start
        return MotionFit(found[self.dynamic], self.x[:, :, k:] @ found[k:], residual)

    def held_out_errors(self, shares: Sequence[float]) -> FloatArray:
        """
        Return what fits with each share leave of other parts of the motion, (S,).

        It is the logarithm of the mean square, its mean over the joints, so that problems with
        other columns are compared in the same units.
        """
        m, n, k = self.x.shape
        weight = _weight(self._settled(1.0)[1])
        x, y = self.x * weight[None, :, None], self.tau * weight
        parts = np.array_split(np.arange(m), _FOLDS)
        products = [(rows.T @ rows, rows.T @ y[part].ravel())
                    for part in parts for rows in [x[part].reshape(-1, k)]]
        gram, right = (np.sum(list(each), axis=0) for each in zip(*products))
        errors = np.zeros((len(shares), n))
        for part, (inside, aim) in zip(parts, products):
            for number, share in enumerate(shares):
                found = _ridge(gram - inside, right - aim, self._prior(share))
                errors[number] += ((self.tau[part] - self.x[part] @ found) ** 2).sum(axis=0)
        least = max(_LEAST * float((self.tau ** 2).max(initial=0.0)), 1e-24)
        return np.asarray(np.log(np.maximum(errors / m, least)).mean(axis=1))

    def _prior(self, share: float) -> FloatArray:
        """Return the information (K,) before any data, in samples of unit weight."""
        usual = self.usual.copy()
        usual[self.dynamic] *= share
        return np.asarray(usual ** -2.0 * self.samples_per_observation)

    def _settled(self, share: float) -> tuple[FloatArray, FloatArray]:
        """Return coefficients (K,) and the residual (M, N) with each joint weighted by its own."""
        prior, residual = self._prior(share), self.tau
        for _ in range(_ROUNDS):
            weight = _weight(residual)
            rows = (self.x * weight[None, :, None]).reshape(self.tau.size, -1)
            found = _ridge(rows.T @ rows, rows.T @ (self.tau * weight).ravel(), prior)
            residual = self.tau - self.x @ found
        return found, residual


def _weight(residual: FloatArray) -> FloatArray:
    """Return the weight (N,) of each joint by its residual (M, N)."""
    left = residual.std(axis=0)
    return np.asarray(1.0 / np.maximum(left, max(1e-6 * float(left.max()), 1e-12)))


def _ridge(gram: FloatArray, right: FloatArray, prior: FloatArray) -> FloatArray:
    """Return the coefficients; what neither data nor prior determine is 0."""
    gram = gram + np.diag(prior)
    size = np.sqrt(np.maximum(np.diag(gram), 1e-24))
    inverse = np.linalg.pinv(gram / np.outer(size, size), rcond=1e-13, hermitian=True)
    return np.asarray(inverse @ (right / size) / size)


def friction(motion: Motion, joint: int) -> FloatArray:
    """Return the columns (M, 3) of dry and viscous friction and an offset."""
    qd = motion.samples.qd[:, joint]
    return np.column_stack([motion.direction(joint), qd, np.ones(len(qd))])


def independent(samples: JointSamples) -> float:
    """Return how many samples count as independent, by the time that they cover."""
    lasts = sum(float(np.ptp(samples.t[run])) for run in run_slices(samples))
    return float(min(max(_INDEPENDENT * lasts, _FEWEST), max(len(samples), 1)))


def samples_per_observation(samples: JointSamples) -> float:
    """Return how many samples count as one against what is known of coefficients."""
    return len(samples) / min(independent(samples), _MOST)


def _on_joint(joint: int, n: int, columns: FloatArray) -> FloatArray:
    """Return columns (M, K) of one joint among those of all, (M, N, K)."""
    whole = np.zeros((len(columns), n, columns.shape[1]))
    whole[:, joint] = columns
    return whole
