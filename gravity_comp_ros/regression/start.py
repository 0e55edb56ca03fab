"""
Start of the axes of an arm without a description.

The squared error has several minima. A few searches from random axes, with generic friction, an
offset and own inertia of each joint, find the best one; a wrong one shows by a residual of several
times that of the right one.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_fit import ChainFit, rough_fit
from gravity_comp_ros.models.kinematic.chain_starts import SearchOptions
from gravity_comp_ros.models.kinematic.nuisance import Nuisance
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
        fits.append(rough_fit(samples, nuisance, SearchOptions(_STARTS, seed)))
        if sum(each.clean for each in fits) == _CLEAN:
            break
    return min(fits, key=lambda fit: _log_noise(fit, problem.white_noise)).chain


def _log_noise(fit: ChainFit, white: FloatArray) -> float:
    """
    Return the mean logarithm of the joints' noise, independent of their scale.

    :param white: noise (N,) of a row in N·m. A smaller residual is that of too many columns.
    """
    return float(np.log(np.maximum(fit.noise.absolute, white)).mean())


def generic_poses(problem: Problem, count: int) -> tuple[JointSamples, Nuisance]:
    """Return means over rows as samples, and the generic columns of each joint."""
    mean, samples = problem.rows.mean, problem.samples
    rows = np.unique(np.linspace(0, problem.rows.n_rows - 1, count).astype(int))
    q, qd, qdd = (mean(x)[rows] for x in (samples.q, samples.qd, problem.motion.qdd))
    columns = np.stack([np.ones(qd.shape), np.tanh(qd / _WIDTH), qd, qdd])
    poses = JointSamples.single_run(samples.names, np.arange(len(rows), dtype=np.float64), q, qd,
                                    problem.y[rows])
    return poses, Nuisance(columns.transpose(2, 0, 1), np.array(_SPREAD))
