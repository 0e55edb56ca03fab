"""
Noise of each joint's torque, estimated from the residual.

Torque sensors and motor currents have an absolute error and one that grows with the load, so

    sigma_n(tau)^2 = a_n^2 + b_n^2 tau_n^2 = a_n^2 (1 + c_n tau_n^2 / mean(tau_n^2)).

tau is the predicted torque, because weights from the measured torque would be correlated with the
noise.
"""

from __future__ import annotations

from gravity_comp_ros.data.constants import MAD
from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
import numpy as np

# Minimum standard deviation, as a share of the arm's largest torque: a joint that measures exactly
# 0 (the first of a level arm) must not get an infinite weight.
_FLOOR = 1e-4
# Log-likelihood ratio above which noise that grows with the torque is accepted.
_MIN_LOG_LIKELIHOOD = 8.0
# Maximum b. A larger estimate indicates a poor model rather than a sensor error, and would give
# the samples with little load all the weight.
_MAX_RELATIVE = 0.5
# Ratios of the variance that grows with the torque to the constant one, at the mean square torque,
# that are compared: less is not visible, more leaves no constant part.
_GROWTH = np.geomspace(0.1, 1e4, 20)
# Residual in standard deviations beyond which a sample has less weight: it has 16 in a million.
OUTLIER = 4.0
# Correlation times of white noise are estimated below this, in samples.
WHITE = 2.0


def floor(tau: FloatArray) -> float:
    """Return the minimum standard deviation in N·m for torques (M, N)."""
    return float(max(_FLOOR * np.sqrt((tau ** 2).mean(axis=0)).max(initial=0.0), 1e-9))


def of_second_differences(values: FloatArray, kept: BoolArray) -> FloatArray:
    """
    Return the standard deviation (N,) of the white noise on slowly changing values (M, N).

    The second difference of white noise has six times its variance; the median is robust to jumps.

    :param kept: mask of the M - 2 differences to use.
    """
    medians = [np.median(np.abs(np.diff(joint, 2)[kept])) for joint in values.T]
    return MAD * np.array(medians) / np.sqrt(6.0)


def robust_std(residual: FloatArray) -> FloatArray:
    """Return the standard deviation (N,) of residuals (M, N) by their medians."""
    return np.asarray(np.maximum(MAD * np.median(np.abs(residual), axis=0), 1e-12))


def outlier_weights(residual: FloatArray, minimum: float = 0.0) -> FloatArray:
    """
    Return the weights (M, N) of squared residuals (M, N): 1, less for outliers.

    Beyond c = `OUTLIER` standard deviations the weight is (c sigma / r)^2, so that the evidence of
    a sample, r^2 / (2 sigma^2) times its weight, is at most c^2 / 2 nats. Many outliers that a
    term explains are evidence for it, a single one is not.

    :param minimum: smallest standard deviation sigma, in the unit of the residual.
    """
    limit = OUTLIER * np.maximum(robust_std(residual), minimum)
    return np.asarray(np.minimum(1.0, limit / np.maximum(np.abs(residual), 1e-12)) ** 2)


def is_outlier(weights: FloatArray) -> BoolArray:
    """Return the mask of residuals beyond twice the limit of full weight (`outlier_weights`)."""
    return np.asarray(weights < 0.25)


def remaining_std(residual: FloatArray, used: FloatArray, minimum: float) -> FloatArray:
    """
    Return the standard deviation (N,) of the noise of residuals (M, N), in their unit.

    :param used: degrees of freedom of the fit on each joint (N,).
    :param minimum: minimum standard deviation (`floor`).
    """
    m = len(residual)
    share = np.maximum((m - used) / m, 0.1)
    return np.asarray(np.maximum(np.sqrt((residual ** 2).mean(axis=0) / share), minimum))


def growth(residual: FloatArray, torque: FloatArray) -> float:
    """
    Return c of the variance a^2 (1 + c x) of residuals (M,), x the squared torque over its mean.

    It is that of the largest likelihood over a^2 and c; without enough evidence it is 0.

    :param torque: (M,) predicted, in N·m.
    """
    square, mean = residual ** 2, float((torque ** 2).mean())
    x = torque ** 2 / max(mean, 1e-300)

    def cost(c: float) -> float:
        spread = 1.0 + c * x
        return 0.5 * float(len(x) * np.log((square / spread).mean() + 1e-300)
                           + np.log(spread).sum())

    logs = np.log(_GROWTH)
    costs = np.array([cost(c) for c in _GROWTH])
    k = int(np.clip(np.argmin(costs), 1, len(logs) - 2))
    # The minimum of the parabola through the best one and its neighbours.
    left, right = costs[k - 1] - costs[k], costs[k + 1] - costs[k]
    curvature = left + right
    step = 0.5 * (left - right) / curvature if curvature > 0.0 else 0.0
    c = float(np.exp(logs[k] + np.clip(step, -1.0, 1.0) * (logs[1] - logs[0])))
    relative = np.sqrt(c * (square / (1.0 + c * x)).mean() / max(mean, 1e-300))
    return c if cost(0.0) - cost(c) > _MIN_LOG_LIKELIHOOD and relative < _MAX_RELATIVE else 0.0


def correlation_time(residual: FloatArray, runs: IntArray) -> float:
    """
    Return the integrated autocorrelation time of a residual (M,), in samples.

    It is 1 + 2 sum_k rho_k, summed until rho_k falls below its own standard error; samples of
    different runs are independent.
    """
    power = float(residual @ residual)
    if power <= 0.0 or len(residual) < 4:
        return 1.0
    edges = np.flatnonzero(np.diff(runs)) + 1
    size = 2 ** int(np.ceil(np.log2(2 * max(np.diff([0, *edges, len(residual)])))))
    correlation = np.zeros(size // 2)
    for part in np.split(residual, edges):
        spectrum = np.abs(np.fft.rfft(part, size)) ** 2
        correlation += np.fft.irfft(spectrum, size)[:size // 2]
    rho = correlation[1:] / power
    small = np.flatnonzero(rho < 2.0 / np.sqrt(len(residual)))
    return float(1.0 + 2.0 * rho[:small[0] if small.size else len(rho)].sum())


def inflation(residual: FloatArray, runs: IntArray) -> FloatArray:
    """Return samples per independent one (N,): the correlation times, 1 for white residuals."""
    times = correlation_times(residual, runs)
    return np.where(times < WHITE, 1.0, times)


def correlation_times(residual: FloatArray, runs: IntArray) -> FloatArray:
    """Return the `correlation_time` of each column of a residual (M, N), shape (N,)."""
    return np.array([correlation_time(column, runs) for column in residual.T])
