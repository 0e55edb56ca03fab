"""
The per-joint formulation of Yu 2022: one independent sparse sum for each joint's torque.

tau_n = F beta_n over all 3^N features (Yu 2022, Eqs. 5-9). It is accurate within the trained
range. Outside, the joints' torques are not coupled, and the error can exceed the torque itself.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.models.sparse.identifiability import usable_for_torque
from gravity_comp_ros.models.sparse.regressor import TorqueDesign
from gravity_comp_ros.models.sparse.sparse_fit import fit_sparse
from gravity_comp_ros.models.sparse.sparse_problem import SparseFit, SparseOptions, SparseProblem


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
