"""
The per-joint formulation of Yu 2022: one independent sparse sum for each joint's torque.

tau_n = F beta_n over all 3^N features (Yu 2022, Eqs. 5-9). It is accurate within the trained
range. Outside, the joints' torques are not coupled, and the error can exceed the torque itself.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.models.sparse.identifiability import usable_for_torque
from gravity_comp_ros.models.sparse.regressor import TorqueDesign
from gravity_comp_ros.models.sparse.sparse_fit import fit_sparse
from gravity_comp_ros.models.sparse.sparse_problem import SparseFit, SparseOptions, SparseProblem


def fit_per_joint(samples: JointSamples, options: SparseOptions,
                  old: tuple[Expansion, ...] | None = None,
                  columns: FloatArray | None = None, trust: FloatArray | None = None,
                  spread: FloatArray | None = None
                  ) -> tuple[tuple[Expansion, ...], list[SparseFit]]:
    """
    Fit each joint's torque separately.

    :param old: the torques of an old model to start from.
    :param columns: nuisance columns (K, N, M), torque per unit of coefficient.
    :param trust: robust weights (M, N) of squared residuals.
    :param spread: prior standard deviations (K,) of the coefficients, per N·m of noise; None
        where all are free.
    :return: one expansion per joint in N·m, and their sparse fits.
    :raises FitError: if there are no samples.
    """
    usable = usable_for_torque(samples.q)
    design_type = options.arrays.design_type(TorqueDesign)
    problems = [SparseProblem(design_type, samples.q, samples.tau[:, [joint]], samples.runs,
                              usable, _of_joint(columns, joint),
                              None if trust is None else trust[:, [joint]],
                              None if spread is None or columns is None
                              else spread[columns[:, joint].any(axis=1)])
                for joint in range(samples.n_joints)]
    fits = [fit_sparse(problem, options, old[joint].indices if old else None)
            for joint, problem in enumerate(problems)]
    return tuple(Expansion(fit.indices, fit.x) for fit in fits), fits


def _of_joint(columns: FloatArray | None, joint: int) -> FloatArray | None:
    """Return the nuisance columns (1, M, K) of a joint, None without any."""
    if columns is None:
        return None
    own = columns[:, joint][columns[:, joint].any(axis=1)]
    return own.T[None] if len(own) else None
