"""
Sparse fits: of one potential energy for all joints, or of one sum for each joint's torque.

Potential: U = sum_k theta_k phi_k(q), tau_n = dU/dq_n. All joints share theta, so the data of each
joint determine the others as well. Non-conservative torques (friction) and offsets cannot be
represented and remain in the residual.

Per joint: tau_n = F beta_n over all 3^N features (Yu 2022, Eqs. 5-9). It is accurate within the
trained range. Outside, the joints' torques are not coupled, and the error can exceed the torque
itself.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.models.sparse.identifiability import (
    AT_REST, usable_for_energy, usable_for_torque)
from gravity_comp_ros.models.sparse.regressor import EnergyDesign, TorqueDesign
from gravity_comp_ros.models.sparse.sparse_problem import (
    finish, grow, prune, SparseFit, SparseOptions, SparseProblem, with_all_samples)
from gravity_comp_ros.models.sparse.variance_inflation import choose_inflation, correlation_time

# Number of evenly spread samples beyond which the support does not change.
_MAX_SAMPLES = 1500


def fit_potential(samples: JointSamples, options: SparseOptions
                  ) -> tuple[Expansion, list[SparseFit]]:
    """
    Fit one sparse potential energy to the torques of all joints.

    :return: the energy in J, and its sparse fit.
    :raises FitError: if there are no samples.
    """
    problem = SparseProblem(options.arrays.design_type(EnergyDesign), samples.q, samples.tau,
                            samples.runs, usable_for_energy(samples.q))
    fit = fit_sparse(problem, options)
    return Expansion(fit.indices, fit.x), [fit]


def fit_per_joint(samples: JointSamples, options: SparseOptions
                  ) -> tuple[tuple[Expansion, ...], list[SparseFit]]:
    """
    Fit each joint's torque separately.

    :return: one expansion per joint in N·m, and their sparse fits.
    :raises FitError: if there are no samples.
    """
    usable = usable_for_torque(samples.q)
    design_type = options.arrays.design_type(TorqueDesign)
    fits = [fit_sparse(SparseProblem(design_type, samples.q, samples.tau[:, [joint]],
                                     samples.runs, usable), options)
            for joint in range(samples.n_joints)]
    return tuple(Expansion(fit.indices, fit.x) for fit in fits), fits


def fit_sparse(problem: SparseProblem, options: SparseOptions) -> SparseFit:
    """
    Return the sparse fit of `problem`: the support from thinned samples, coefficients from all.

    :raises FitError: if there are no samples.
    """
    problem = problem.merged(AT_REST)
    few = problem.thinned(_MAX_SAMPLES)
    if options.inflation is None:
        grown = grow(few, options)
        inflation = choose_inflation(few, grown, options).inflation
        pruned = prune(few, grown, inflation)
    else:
        inflation = options.inflation
        pruned = grow(few, options, inflation)
    if few is problem:
        return finish(problem, pruned, inflation, options)
    full = with_all_samples(problem, pruned)
    # Samples closer in time are more strongly autocorrelated.
    ratio = correlation_time(problem, full) / correlation_time(few, pruned)
    return finish(problem, full, inflation * max(ratio, 1.0), options)
