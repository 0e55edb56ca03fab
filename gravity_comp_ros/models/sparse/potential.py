"""
The potential formulation: gravity is the gradient of one sparse energy.

U = sum_k theta_k phi_k(q), tau_n = dU/dq_n. All joints share theta, so the data of each joint
determine the others as well. Non-conservative torques (friction) and offsets cannot be represented
and remain in the residual.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.models.sparse.identifiability import usable_for_energy
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.models.sparse.sparse_fit import fit_sparse
from gravity_comp_ros.models.sparse.sparse_problem import SparseFit, SparseOptions, SparseProblem


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
