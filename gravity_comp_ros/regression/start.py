"""
Start of the axes of an arm without a description.

The squared error has several minima. A few searches from random axes, with generic friction, an
offset and own inertia of each joint, find the best one; a wrong one shows by a residual of several
times that of the right one.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_fit import ChainFit, NuisanceDesign, rough_fit
from gravity_comp_ros.models.kinematic.chain_starts import SearchOptions
from gravity_comp_ros.regression.problem import Problem
import numpy as np

# Number of searches, starts of each, and poses that they use.
_SEARCHES, _STARTS, _POSES = 4, 24, 400
# Number of searches with a white residual after which it ends: few poses are consistent with
# several chains.
_CLEAN = 2
# Width in rad/s of the direction of generic friction.
_WIDTH = 0.01
# Prior standard deviations of offset, Coulomb and viscous friction and inertia per N·m of noise.
_SPREAD = (3.0, 30.0, 300.0, 30.0)


def start_chain(problem: Problem) -> Chain:
    """
    Return the axes and moments of the best of a few searches.

    :raises FitError: if there are no samples.
    """
    samples, nuisance = generic_poses(problem, _POSES)
    fits: list[ChainFit] = []
    for seed in range(_SEARCHES):
        fits.append(rough_fit(samples, SearchOptions(starts=_STARTS, rivals=0, seed=seed), None,
                              nuisance))
        if sum(each.clean for each in fits) == _CLEAN:
            break
    return min(fits, key=_log_noise).chain


def _log_noise(fit: ChainFit) -> float:
    """Return the mean logarithm of the joints' noise, independent of their scale."""
    return float(np.log(fit.noise.absolute).mean())


def generic_poses(problem: Problem, count: int) -> tuple[JointSamples, NuisanceDesign]:
    """Return means over rows as samples, and the generic columns of each joint."""
    mean, samples = problem.rows.mean, problem.samples
    rows = np.unique(np.linspace(0, problem.rows.n_rows - 1, count).astype(int))
    q, qd, qdd = (mean(x)[rows] for x in (samples.q, samples.qd, problem.motion.qdd))
    n = samples.n_joints
    columns: list[FloatArray] = []
    for joint in range(n):
        for values in (np.ones(len(rows)), np.tanh(qd[:, joint] / _WIDTH), qd[:, joint],
                       qdd[:, joint]):
            column = np.zeros((n, len(rows)))
            column[joint] = values
            columns.append(column)
    poses = JointSamples.single_run(samples.names, np.arange(len(rows), dtype=np.float64), q, qd,
                                    problem.y[rows])
    return poses, NuisanceDesign(np.array(columns), None, np.tile(_SPREAD, n))
