"""
Selection of the faults of a description by their evidence.

    tau = g(q; faults) + dynamics + N_j c_j + e,   N_j: 1, directions of friction, speed

The dynamic torque is that of the description. The error e has the standard deviation of the sensor
noise and of a stated discrepancy, and its samples are autocorrelated. The log evidence of a fault
is that of Laplace: half the decrease of the squared residual, minus the deviation of its
parameters from their start in prior standard deviations, minus half log det of the information in
these units, minus the logarithm of the number of faults that were compared. Faults are added
while each raises the evidence; the parameters of all are fitted together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.runs import per_error
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.description_check.faults import (
    AXIS_TURNED, CheckOptions, Fault, FaultyArm)
from gravity_comp_ros.effects.motion_direction import directions
from gravity_comp_ros.models.noise import floor
from gravity_comp_ros.regression.options import EngineOptions
import numpy as np

_ENGINE = EngineOptions()


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


class FaultEvidence:
    """
    The recording, and the log likelihood of arms.

    :param samples: recorded torques without the dynamic torque.
    :param noise: standard deviation of the sensors (N,), N·m.
    :param arm: of which the residual shows the size of friction.
    """

    def __init__(self, samples: JointSamples, noise: FloatArray, arm: FaultyArm,
                 options: CheckOptions) -> None:
        self.q, self.options, tau = samples.q, options, samples.tau
        columns = [np.column_stack([np.ones(len(tau)), directions(samples, j), qd])
                   for j, qd in enumerate(samples.qd.T)]
        rest = tau - arm.gravity(self.q)
        friction = [np.std(part[:, 1:] @ np.linalg.lstsq(part, y, rcond=None)[0][1:])
                    for part, y in zip(columns, rest.T)]
        sigma = np.sqrt(noise ** 2 + (options.discrepancy * np.ptp(tau, axis=0)) ** 2
                        + (options.friction_discrepancy * np.array(friction)) ** 2)
        of_error = per_error(samples.t, samples.runs, _ENGINE.block_seconds)
        self.weight = 1.0 / (np.maximum(sigma, floor(tau)) * np.sqrt(of_error))
        self._bases = np.stack([_basis(part) for part in columns])
        self.target = self.weighted(tau)

    def weighted(self, torque: FloatArray) -> FloatArray:
        """Return a torque without offset and friction, in standard deviations, flat."""
        by_joint = torque.T[:, :, None]
        rest = by_joint - self._bases @ (self._bases.transpose(0, 2, 1) @ by_joint)
        return np.asarray((rest[:, :, 0].T * self.weight).ravel())

    def residual(self, arm: FaultyArm) -> FloatArray:
        """Return the residual of an arm in standard deviations, (M N,)."""
        return self.target - self.weighted(arm.gravity(self.q))

    def fitted(self, arm: FaultyArm, faults: Sequence[Fault], start: FloatArray,
               prior: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """
        Return parameters, covariance and log posterior of faults from a start, by least squares.

        :param prior: mean of the parameters.
        """
        from scipy.optimize import least_squares  # imported here because it takes 0.3 s
        scale = np.concatenate([fault.scale for fault in faults])

        def deviation(p: FloatArray) -> FloatArray:
            """Return residual and deviation from the prior, in standard deviations."""
            return np.append(self.residual(changed(arm, faults, p)), (p - prior) / scale)

        if not len(start):
            return start, np.zeros((0, 0)), -_cost(deviation(start))
        fit = least_squares(deviation, start, x_scale=scale, ftol=1e-5, max_nfev=_ENGINE.steps)
        information = scale[:, None] * (fit.jac.T @ fit.jac) * scale
        return (fit.x, scale[:, None] * np.linalg.inv(information) * scale,
                -float(fit.cost) - 0.5 * float(np.linalg.slogdet(information)[1]))


def changed(arm: FaultyArm, faults: Sequence[Fault], parameters: FloatArray) -> FaultyArm:
    """Return the arm with faults, their parameters one after another."""
    own = np.split(parameters, np.cumsum([fault.size for fault in faults]))
    # An axis is turned in the frame of the description, before that frame turns.
    for fault, part in sorted(zip(faults, own), key=lambda each: each[0].kind != AXIS_TURNED):
        arm = fault.change(arm, part)
    return arm


def search(evidence: FaultEvidence, arm: FaultyArm, faults: Sequence[Fault]
           ) -> tuple[list[FaultFit], FaultFit]:
    """Return the faults of a description in the order of their evidence, and the next one."""
    options, selected = evidence.options, list[FaultFit]()
    while True:
        best = _best(evidence, arm, selected, faults)
        if best.evidence < _ENGINE.min_gain or len(selected) == options.max_faults:
            return sorted(selected, key=lambda fit: -fit.evidence), best
        selected = _together(evidence, arm, [*selected, best])
        if len(selected) > 1:
            selected = _exchanged(evidence, arm, selected, faults)


def _best(evidence: FaultEvidence, arm: FaultyArm, others: Sequence[FaultFit],
          faults: Sequence[Fault]) -> FaultFit:
    """Return the fault of the largest evidence in addition to others, with its alternatives."""
    state = corrected(arm, others)
    before = -_cost(evidence.residual(state))
    fits = [_best_start(evidence, state, fault, before, float(np.log(len(faults))))
            for fault in faults if all(fault is not fit.fault for fit in others)]
    fits.sort(key=lambda fit: -fit.evidence)
    # Factors of one unit are near another one too: the same fault.
    other = {(fit.fault.kind, fit.fault.subjects): fit for fit in reversed(fits)}
    return replace(fits[0], alternatives=tuple(
        fit for fit in fits[1:] if fits[0].evidence - fit.evidence < _ENGINE.margin
        and fit is other[fit.fault.kind, fit.fault.subjects]))


def _exchanged(evidence: FaultEvidence, arm: FaultyArm, selected: list[FaultFit],
               faults: Sequence[Fault]) -> list[FaultFit]:
    """Return the faults after each was compared again, given the others."""
    for fit in list(selected):
        others = [other for other in selected if other is not fit]
        best = _best(evidence, arm, others, faults)
        if best.evidence < _ENGINE.min_gain:
            selected = others
        elif best.fault is not fit.fault:
            selected = _together(evidence, arm, [*others, best])
            break
    return selected


def _best_start(evidence: FaultEvidence, arm: FaultyArm, fault: Fault, before: float,
                log_odds: float) -> FaultFit:
    results = []
    for start in fault.starts:
        p, covariance, posterior = evidence.fitted(arm, [fault], start, start)
        results.append(FaultFit(fault, p, covariance, posterior - before - log_odds
                                - float(np.log(len(fault.starts)))))
    return max(results, key=lambda fit: fit.evidence)


def _together(evidence: FaultEvidence, arm: FaultyArm, fits: Sequence[FaultFit]) -> list[FaultFit]:
    """Return the faults with all parameters fitted together."""
    faults, start = [fit.fault for fit in fits], _joined(fits)
    nearest = [fit.fault.starts[np.argmin(np.abs(fit.fault.starts - fit.parameters).sum(axis=1))]
               for fit in fits]
    p, covariance, _ = evidence.fitted(arm, faults, start, np.concatenate(nearest))
    result, first = [], 0
    for fit in fits:
        own = slice(first, first + fit.fault.size)
        result.append(replace(fit, parameters=p[own], covariance=covariance[own, own]))
        first += fit.fault.size
    return result


def _basis(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of columns, some of which may be 0, and are in the basis."""
    basis, size, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(basis * (size > 1e-9 * size[0]))


def corrected(arm: FaultyArm, fits: Sequence[FaultFit]) -> FaultyArm:
    """Return the arm without faults of its description."""
    return changed(arm, [fit.fault for fit in fits], _joined(fits))


def _joined(fits: Sequence[FaultFit]) -> FloatArray:
    return np.concatenate([np.zeros(0), *(fit.parameters for fit in fits)])


def _cost(residual: FloatArray) -> float:
    return 0.5 * float(residual @ residual)
