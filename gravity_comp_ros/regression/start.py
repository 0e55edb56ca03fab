"""
Start of the axes of an arm without a description.

The squared error has several minima. A few searches from random axes, with generic friction, an
offset and own inertia of each joint, find the best one; a wrong one shows by a residual of several
times that of the right one.
"""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.models.kinematic.chain_fit import ChainFit, rough_fit, SearchOptions
from gravity_comp_ros.models.kinematic.chain_solver import Nuisance
from gravity_comp_ros.regression.linear import gauss_newton, Linear, with_common_terms
from gravity_comp_ros.regression.noise import noise_std
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.unknown_lengths import UnknownLengths
import numpy as np

# Number of searches, starts of each, and poses that they use.
_SEARCHES, _STARTS, _POSES = 4, 24, 400
# Shares of the rows in turn: gravity dominates those with the least motion.
_SHARES = (1.0, 1.0, 0.5, 0.5)
# Number of searches with a white residual after which it ends: few poses are consistent with
# several chains.
_CLEAN = 2
# Number of rows on which the searches are compared.
_ROWS = 400
# Width in rad/s of the direction of generic friction.
_WIDTH = 0.01
# Prior standard deviations of offset, Coulomb and viscous friction and inertia per N·m of noise,
# and the place of inertia.
_SPREAD = (3.0, 30.0, 300.0, 30.0)
INERTIA = 3
# Rows of a recording with an offset of its own: twice the number of generic columns.
_OWN_OFFSET = 8


def start_axes(problem: Problem, effects: Sequence[Effect]) -> UnknownLengths:
    """
    Return the axes and moments of the best of a few searches.

    Each is estimated together with the effects that are common in joints, because generic friction
    may hide a wrong axis.

    :raises FitError: if there are no samples.
    """
    few = _thinned(problem, _ROWS)
    minima: list[ChainFit] = []
    n_clean = 0
    for seed in range(_SEARCHES):
        poses = generic_poses(problem, _POSES, _SHARES[seed])
        rough = rough_fit(*poses, SearchOptions(_STARTS, seed))
        same = next((k for k, other in enumerate(minima)
                     if _are_same(rough, other, poses[0].q)), None)
        if same is None:
            minima.append(rough)
        elif rough.clean:
            minima[same] = rough
        n_clean += rough.clean
        if n_clean == _CLEAN:
            # A minimum whose residual is not white is wrong if others have a white one.
            minima = [each for each in minima if each.clean]
            break
    best = min((with_common_terms(few, UnknownLengths.of(each.chain), effects)
                for each in minima), key=_log_noise)
    # Gravity does not depend on the direction of a vertical first axis, the torque of motion does.
    reversed_ = best.on(UnknownLengths.of(_axes_of(best).chain.with_first_reversed()),
                        best.posterior.precision, is_known=False)
    return _axes_of(min(best, gauss_newton(reversed_, renewed=True)[0], key=_log_noise))


def _are_same(one: ChainFit, other: ChainFit, q: FloatArray) -> bool:
    """Return whether the gravity of two fits differs by less than the noise of the better one."""
    change = np.sqrt(((one.chain.torque(q) - other.chain.torque(q)) ** 2).mean(axis=0))
    return bool((change < np.minimum(one.noise.absolute, other.noise.absolute)).all())


def _axes_of(fit: Linear) -> UnknownLengths:
    assert isinstance(fit.shared, UnknownLengths)
    return fit.shared


def _thinned(problem: Problem, count: int) -> Problem:
    """Return the problem of evenly picked rows, at most `count`."""
    rows = problem.rows
    if rows.n_rows <= count:
        return problem
    picked = np.unique(np.linspace(0, rows.n_rows - 1, count).astype(int))
    use = np.zeros(problem.samples.n_samples, dtype=bool)
    use[rows.samples[np.isin(np.repeat(np.arange(rows.n_rows), rows.count), picked)]] = True
    return Problem.of(problem.samples, use, problem.options)


def _log_noise(fit: Linear) -> float:
    """
    Return the mean logarithm of the joints' noise, independent of their scale.

    A residual below the white noise is that of too many columns.
    """
    problem = fit.problem
    noise = noise_std(fit.at_point(), problem.scale, problem.options)
    return float(np.log(np.maximum(noise, problem.white_noise)).mean())


def generic_poses(problem: Problem, count: int, share: float = 1.0
                  ) -> tuple[JointSamples, Nuisance]:
    """
    Return means over rows as samples, and the generic columns of each joint.

    They are offset, Coulomb and viscous friction and inertia, then the deviations of the offset
    in later recordings: sensors may be zeroed at each start.

    :param count: number of rows, evenly picked among those with the least motion.
    :param share: of the rows with the least motion, by |qdd| + qd^2 of all joints.
    """
    mean, samples = problem.rows.mean, problem.samples
    q, qd, qdd = (mean(x) for x in (samples.q, samples.qd, problem.motion.qdd))
    motion = (np.abs(qdd) + qd ** 2).sum(axis=1)
    slow = np.flatnonzero(motion <= np.quantile(motion, share))
    rows = slow[np.unique(np.linspace(0, len(slow) - 1, count).astype(int))]
    q, qd, qdd = q[rows], qd[rows], qdd[rows]
    later = later_recordings(problem.rows.run[rows], _OWN_OFFSET)
    columns = np.stack([np.ones(qd.shape), np.tanh(qd / _WIDTH), qd, qdd,
                        *(np.ones(qd.shape) * own[:, None] for own in later)])
    spread = np.array([*_SPREAD, *_SPREAD[:1] * len(later)])
    poses = JointSamples(samples.names, problem.rows.t[rows], q, qd, problem.y[rows],
                         problem.rows.run[rows], samples.run_labels)
    return poses, Nuisance(columns.transpose(2, 0, 1), spread)


def later_recordings(runs: IntArray, min_rows: int) -> list[BoolArray]:
    """Return the masks (M,) of the recordings after the first one that have enough rows."""
    numbers, counts = np.unique(runs, return_counts=True)
    return [runs == number for number in numbers[counts >= min_rows][1:]]
