"""
Sparse fits: of one potential energy for all joints, or of one sum for each joint's torque.

Potential: U = sum_k theta_k phi_k(q), tau_n = dU/dq_n. All joints share theta, so the data of each
joint determine the others as well. Non-conservative torques (friction) and offsets cannot be
represented and remain in the residual.

Per joint: tau_n = F beta_n over all 3^N features (Yu 2022, Eqs. 5-9). It is accurate within the
trained range. Outside, the joints' torques are not coupled, and the error can exceed the torque
itself.

The variance inflation factor is selected on held-out data. A white residual requires no inflation.
An autocorrelated residual (friction, hysteresis, drift) is overfitted by the growing support, with
large errors on the next run. So factors up to twice the residual's correlation time are tried on
held-out runs, or on blocks of ten seconds if there are too few runs. The largest factor whose
error is within one standard error of the lowest is selected, which yields the smallest support of
that accuracy.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.models.sparse.identifiability import usable_for_energy, usable_for_torque
from gravity_comp_ros.models.sparse.regressor import EnergyDesign, TorqueDesign
from gravity_comp_ros.models.sparse.sparse_problem import (
    finish, grow, prune, SparseFit, SparseProblem, SupportFit)
import numpy as np

# Variance inflation factors that are tried.
_FACTORS = (1.0, 3.0, 10.0, 30.0, 100.0)


def fit_potential(samples: JointSamples, fold: IntArray
                  ) -> tuple[Expansion, list[SparseFit]]:
    """
    Fit one sparse potential energy to the torques of all joints.

    :param fold: numbers (M,) of the samples that are held out together.
    :return: the energy in J, and its sparse fit.
    :raises FitError: if there are no samples.
    """
    problem = SparseProblem(EnergyDesign, samples.q, samples.tau,
                            samples.runs, fold, usable_for_energy(samples.q))
    fit = fit_sparse(problem)
    return Expansion(fit.indices, fit.x), [fit]


def fit_per_joint(samples: JointSamples, fold: IntArray
                  ) -> tuple[tuple[Expansion, ...], list[SparseFit]]:
    """
    Fit each joint's torque separately.

    :param fold: numbers (M,) of the samples that are held out together.
    :return: one expansion per joint in N·m, and their sparse fits.
    :raises FitError: if there are no samples.
    """
    usable = usable_for_torque(samples.q)
    fits = [fit_sparse(SparseProblem(TorqueDesign, samples.q, samples.tau[:, [joint]],
                                     samples.runs, fold, usable))
            for joint in range(samples.n_joints)]
    return tuple(Expansion(fit.indices, fit.x) for fit in fits), fits


def fit_sparse(problem: SparseProblem) -> SparseFit:
    """
    Return the sparse fit of `problem`.

    :raises FitError: if there are no samples.
    """
    grown = grow(problem)
    inflation = choose_inflation(problem, grown)
    return finish(problem, prune(problem, grown, inflation), inflation)


def choose_inflation(problem: SparseProblem, grown: SupportFit) -> float:
    """Return the variance inflation factor for a grown support."""
    times = noise.correlation_times(grown.residual, problem.runs)
    time = float(np.median(times))
    tried = [k for k in _FACTORS if k == 1.0 or k < 2.0 * time]
    if time < noise.WHITE or len(tried) < 2:
        return 1.0
    scale = np.sqrt((grown.residual ** 2).mean(axis=0)) + noise.floor(problem.tau)
    errors = np.array([_held_out(problem, problem.fold == k, tried, scale)
                       for k in np.unique(problem.fold)])
    best = int(np.argmin(errors.mean(axis=0)))
    excess = errors - errors[:, [best]]
    allowed = excess.mean(axis=0) <= excess.std(axis=0, ddof=1) / np.sqrt(len(errors))
    return max(k for k, is_allowed in zip(tried, allowed) if is_allowed or k == tried[best])


def _held_out(problem: SparseProblem, test: BoolArray, tried: list[float],
              scale: FloatArray) -> FloatArray:
    """Return the mean square error on the held-out mask `test`, for each factor."""
    train, held_out = problem.select(~test), problem.select(test)
    fit = grow(train)
    errors = []
    for inflation in tried:
        fit = prune(train, fit, inflation)
        predicted = held_out.predict(fit.refit.indices, fit.refit.x)
        errors.append(float((((held_out.tau - predicted) / scale) ** 2).mean()))
    return np.array(errors)
