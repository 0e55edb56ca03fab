"""
Selection of the faults of a description by their evidence.

    tau = g(q; faults) + dynamics + N_j c_j + e,   c_j: offset, Coulomb and viscous friction

The dynamic torque is that of the description. The error e has the standard deviation of the sensor
noise and of a stated discrepancy, and its samples are autocorrelated. The log evidence of a fault
is that of Laplace: half the decrease of the squared residual, minus the deviation of its
parameters from their start in prior standard deviations, minus half log det of the information in
these units, minus the logarithm of the number of faults that were compared. Faults are added
while each raises the evidence; the parameters of all are fitted together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description_check.arm_state import ArmState
from gravity_comp_ros.description_check.faults import Fault
from gravity_comp_ros.errors import OptionError
import numpy as np

_STEPS = 12
_STEP = 1e-4


@dataclass(frozen=True)
class CheckOptions:
    """
    Options of a check.

    `discrepancy` is the share of a joint's torque range that no law of friction and no rigid arm
    explains, as a standard deviation. `correlation` in s is the time over which the errors of
    samples are dependent. `min_evidence` in nats is the least log evidence of a fault, and
    `margin` that by which a fault must exceed others to be named alone. `max_faults` bounds the
    search. `sign_width` in rad/s is the speed over which friction changes its sign.

    :raises OptionError: if a number is not positive.
    """

    discrepancy: float = 0.005
    correlation: float = 2.0
    min_evidence: float = 5.0
    margin: float = 3.0
    max_faults: int = 4
    sign_width: float = 0.01

    def __post_init__(self) -> None:
        if not min(vars(self).values()) > 0.0:
            raise OptionError('check of a description: every option must be positive')


@dataclass(frozen=True, eq=False)
class FaultFit:
    """
    A fault with its parameters (P,), their covariance (P, P) and its log evidence in nats.

    `alternatives` are other faults that explain the recording as well.
    """

    fault: Fault
    parameters: FloatArray
    covariance: FloatArray
    evidence: float
    alternatives: tuple[FaultFit, ...] = ()


class Evidence:
    """
    The recording, and the log likelihood of arms.

    :param q: recorded angles (M, N), rad. :param qd: speeds (M, N), rad/s.
    :param tau: recorded torque minus the dynamic torque (M, N), N·m.
    :param samples_per_error: number of samples over which errors are dependent.
    """

    def __init__(self, q: FloatArray, qd: FloatArray, tau: FloatArray, noise: FloatArray,
                 samples_per_error: float, options: CheckOptions) -> None:
        self.q, self.options = q, options
        sigma = np.hypot(noise, options.discrepancy * np.ptp(tau, axis=0))
        self.weight = 1.0 / (np.maximum(sigma, 1e-9) * np.sqrt(samples_per_error))
        self._bases = [np.linalg.qr(np.column_stack([
            np.ones(len(q)), np.tanh(x / options.sign_width), x]))[0] for x in qd.T]
        self.target = self.weighted(tau)

    def weighted(self, torque: FloatArray) -> FloatArray:
        """Return a torque without offset and friction, in standard deviations, flat."""
        rest = np.stack([column - basis @ (basis.T @ column)
                         for basis, column in zip(self._bases, torque.T)], axis=1)
        return np.asarray((rest * self.weight).ravel())

    def residual(self, arm: ArmState) -> FloatArray:
        """Return the residual of an arm in standard deviations, (M N,)."""
        return self.target - self.weighted(arm.gravity(self.q))

    def fitted(self, arm: ArmState, faults: Sequence[Fault], start: FloatArray,
               prior: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """
        Return parameters, covariance and log posterior of faults from a start, by Gauss-Newton.

        :param prior: mean of the parameters.
        """
        scale = np.concatenate([fault.scale for fault in faults])
        p, damping = start.copy(), 1e-3
        residual = self.residual(changed(arm, faults, p))
        cost = _cost(residual, (p - prior) / scale)
        hessian = np.eye(len(p))
        for _ in range(_STEPS if len(p) else 0):
            jacobian = self._jacobian(arm, faults, p, scale)
            hessian = jacobian.T @ jacobian + np.eye(len(p))
            gradient = jacobian.T @ residual - (p - prior) / scale
            while damping < 1e6:
                step = scale * np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)),
                                               gradient)
                after = self.residual(changed(arm, faults, p + step))
                lower = _cost(after, (p + step - prior) / scale)
                if lower < cost:
                    break
                damping *= 10.0
            else:
                break
            decrease, cost, p, residual = cost - lower, lower, p + step, after
            damping *= 0.1
            if decrease < 1e-3:
                break
        covariance = scale[:, None] * np.linalg.inv(hessian) * scale
        return p, covariance, -cost - 0.5 * float(np.linalg.slogdet(hessian)[1])

    def _jacobian(self, arm: ArmState, faults: Sequence[Fault], p: FloatArray,
                  scale: FloatArray) -> FloatArray:
        """Return d torque / d parameters, in standard deviations of both."""
        columns = []
        for k, size in enumerate(scale):
            step = _STEP * size * (np.arange(len(p)) == k)
            columns.append((self.residual(changed(arm, faults, p - step))
                            - self.residual(changed(arm, faults, p + step))) / (2.0 * _STEP))
        return np.column_stack(columns)


def changed(arm: ArmState, faults: Sequence[Fault], parameters: FloatArray) -> ArmState:
    """Return the arm with faults, their parameters one after another."""
    start = 0
    for fault in faults:
        arm = fault.change(arm, parameters[start:start + fault.size])
        start += fault.size
    return arm


def search(evidence: Evidence, arm: ArmState, faults: Sequence[Fault]) -> list[FaultFit]:
    """Return the faults of a description, in the order of their evidence."""
    options, selected = evidence.options, list[FaultFit]()
    log_odds = np.log(len(faults))
    while len(selected) < options.max_faults:
        state = changed(arm, [fit.fault for fit in selected], _joined(selected))
        before = -_cost(evidence.residual(state), np.zeros(0))
        fits = [_best_start(evidence, state, fault, before, log_odds) for fault in faults
                if all(fault is not fit.fault for fit in selected)]
        fits.sort(key=lambda fit: -fit.evidence)
        if not fits or fits[0].evidence < options.min_evidence:
            break
        ties = tuple(fit for fit in fits[1:]
                     if fits[0].evidence - fit.evidence < options.margin)
        refitted = _together(evidence, arm, [*selected, fits[0]], (*(fit.alternatives for fit in
                                                                     selected), ties))
        selected = refitted
    return selected


def _best_start(evidence: Evidence, arm: ArmState, fault: Fault, before: float,
                log_odds: float) -> FaultFit:
    results = []
    for start in fault.starts:
        p, covariance, posterior = evidence.fitted(arm, [fault], start, start)
        results.append(FaultFit(fault, p, covariance, posterior - before - log_odds
                                - float(np.log(len(fault.starts)))))
    return max(results, key=lambda fit: fit.evidence)


def _together(evidence: Evidence, arm: ArmState, fits: Sequence[FaultFit],
              ties: Sequence[tuple[FaultFit, ...]]) -> list[FaultFit]:
    """Return the faults with all parameters fitted together."""
    faults, start = [fit.fault for fit in fits], _joined(fits)
    nearest = [fit.fault.starts[np.argmin(np.abs(fit.fault.starts - fit.parameters).sum(axis=1))]
               for fit in fits]
    p, covariance, _ = evidence.fitted(arm, faults, start, np.concatenate(nearest))
    result, first = [], 0
    for fit, others in zip(fits, ties):
        own = slice(first, first + fit.fault.size)
        result.append(FaultFit(fit.fault, p[own], covariance[own, own], fit.evidence, others))
        first += fit.fault.size
    return result


def _joined(fits: Sequence[FaultFit]) -> FloatArray:
    return np.concatenate([np.zeros(0), *(fit.parameters for fit in fits)])


def _cost(residual: FloatArray, deviation: FloatArray) -> float:
    return 0.5 * float(residual @ residual + deviation @ deviation)
