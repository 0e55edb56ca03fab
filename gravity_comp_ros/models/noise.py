"""
How noisy each joint's torque is, learned from the residual.

Torque sensors and motor currents have an absolute error and one that grows with the load, so

    sigma_n(tau)^2 = a_n^2 + b_n^2 tau_n^2.

Rows are weighted by 1 / sigma_n. tau here is the predicted torque: the measured one would make
samples whose noise happened to be small look precise.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
import numpy as np

# No joint is believed to be better than this share of the arm's largest torque: a joint that
# measures exactly 0 (the first of a level arm) must not get an infinite weight.
_FLOOR = 1e-4
# Gain in log likelihood that the load-dependent part must bring to be believed.
_EVIDENCE = 8.0
# No sensor's error is a larger part of the load: what seems to be is a model that fits badly, and
# must not give the samples with little load all the weight.
_MOST_RELATIVE = 0.5
# Median absolute deviation to standard deviation.
_MAD = 1.4826
# Steps of the estimate, and the longest of them in ln a^2 and ln b^2.
_MOST_STEPS = 100
_LONGEST = 2.0


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Standard deviations: `absolute` a (N,) in N·m and `relative` b (N,), a fraction."""

    absolute: FloatArray
    relative: FloatArray

    def sigma(self, predicted: FloatArray) -> FloatArray:
        """Return sigma for predicted torques (M, N), in N·m."""
        return np.sqrt(self.absolute ** 2 + (self.relative * predicted) ** 2)

    def is_close_to(self, other: NoiseModel) -> bool:
        """Return whether two estimates differ by no more than matters for weights."""
        return bool(np.allclose(self.absolute, other.absolute, rtol=0.05)
                    and np.allclose(self.relative, other.relative, rtol=0.1, atol=1e-4))


def floor(tau: FloatArray) -> float:
    """Return the least standard deviation that is believed, N·m."""
    return float(max(_FLOOR * np.sqrt((tau ** 2).mean(axis=0)).max(initial=0.0), 1e-9))


def of_second_differences(values: FloatArray, kept: BoolArray) -> FloatArray:
    """
    Return the standard deviation (N,) of white noise in values (M, N) that change slowly beside.

    The second difference of white noise has six times its variance; the median leaves out the few
    places where something sets in.

    :param kept: which of the M - 2 differences count.
    """
    bends = [np.median(np.abs(np.diff(joint, 2)[kept])) for joint in values.T]
    return _MAD * np.array(bends) / np.sqrt(6.0)


def first_guess(tau: FloatArray) -> NoiseModel:
    """
    Return the torque itself as its noise, joint by joint.

    Each round of a fit then explains the coarser part of what the last one left, so that noise
    is never taken for signal because it was believed to be small.
    """
    rms = np.sqrt((tau ** 2).mean(axis=0))
    return NoiseModel(np.maximum(rms, floor(tau)), np.zeros(tau.shape[1]))


def estimate(residual: FloatArray, predicted: FloatArray, least: float,
             used: FloatArray) -> NoiseModel:
    """
    Return the noise model of residuals (M, N).

    :param used: degrees of freedom that the fit spent on each joint (N,).
    :param least: `floor` of the measured torque.
    """
    m, n = residual.shape
    absolute, relative = np.zeros(n), np.zeros(n)
    for joint in range(n):
        share = max((m - used[joint]) / m, 0.1)
        absolute[joint], relative[joint] = _estimate_joint(
            residual[:, joint] / np.sqrt(share), predicted[:, joint], least)
    return NoiseModel(absolute, relative)


def _estimate_joint(residual: FloatArray, predicted: FloatArray,
                    least: float) -> tuple[float, float]:
    constant = max(float(np.sqrt((residual ** 2).mean())), least)
    load = float(np.sqrt((predicted ** 2).mean()))
    if load <= least:
        return constant, 0.0

    plain = 0.5 * (np.log(constant ** 2) + float((residual ** 2).mean()) / constant ** 2)
    start = 2.0 * np.log([0.5 * constant, 0.5 * constant / load])
    logs, cost = _most_likely(residual ** 2, predicted ** 2, least ** 2, start)
    absolute, relative = np.exp(0.5 * logs)
    if len(residual) * (plain - cost) < _EVIDENCE or relative > _MOST_RELATIVE:
        return constant, 0.0
    return max(float(absolute), least), float(relative)


def _most_likely(squares: FloatArray, loads: FloatArray, least: float,
                 logs: FloatArray) -> tuple[FloatArray, float]:
    """
    Return ln a^2 and ln b^2 of the variance a^2 + b^2 load + least, and -ln of the likelihood.

    Fisher's scoring: the Hessian is taken as it is on average over the noise, which is never
    negative, so that every step points downhill; it is halved until it gets there.
    """
    def state(logs: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        parts = np.exp(logs)[:, None] * np.stack([np.ones_like(loads), loads])
        variance = parts[0] + parts[1] + least
        excess = squares / variance
        return parts / variance, excess, float(0.5 * (np.log(variance) + excess).mean())

    shares, excess, cost = state(logs)
    for _ in range(_MOST_STEPS):
        gradient = shares @ (1.0 - excess)
        step = -np.linalg.solve(shares @ shares.T + 1e-9 * len(loads) * np.eye(2), gradient)
        step *= min(1.0, _LONGEST / max(float(np.abs(step).max()), 1e-300))
        while True:
            found = state(logs + step)
            if found[2] < cost or np.abs(step).max() < 1e-3:
                break
            step = 0.5 * step
        gain = cost - found[2]
        if gain > 0.0:
            logs, (shares, excess, cost) = logs + step, found
        if gain < 1e-7:
            break
    return logs, cost


def correlation_time(residual: FloatArray, runs: IntArray) -> float:
    """
    Return how many samples of a residual (M,) count as one: its integrated autocorrelation.

    1 + 2 sum_k rho_k, summed until rho_k falls under its own standard error; samples of
    different runs are independent.
    """
    total = len(residual)
    parts = [residual[runs == run] for run in np.unique(runs)]
    power = sum(float(p @ p) for p in parts)
    if power <= 0.0 or total < 4:
        return 1.0
    time = 1.0
    for lag in range(1, max(2, total // 4)):
        rho = sum(float(p[lag:] @ p[:-lag]) for p in parts if len(p) > lag) / power
        if rho < 2.0 / np.sqrt(total):
            break
        time += 2.0 * rho
    return time
