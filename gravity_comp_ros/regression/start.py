"""
Start of the axes of an arm without a description.

The squared error has several minima. Two searches from random axes, with generic friction, an
offset and own inertia of each joint, find the best one. A wrong one has several times its
residual.
"""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.samples import (
    BoolArray, FloatArray, IntArray, JointSamples, spread_over)
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.models.kinematic.arm_solver import ArmProblem, ArmState, Nuisance
from gravity_comp_ros.models.kinematic.chain import in_frames_of_axes
from gravity_comp_ros.models.kinematic.chain_search import search
from gravity_comp_ros.regression.linear import gauss_newton, Linear, with_common_terms
from gravity_comp_ros.regression.noise import noise_std
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.unknown_lengths import UnknownLengths
import numpy as np

# Number of starts of a search, and of poses that it uses.
_STARTS, _POSES = 24, 400
# Shares of the rows in the searches: gravity dominates those with the least motion.
_SHARES = (1.0, 0.5)
# Number of rows on which the searches are compared.
_ROWS = 400
# Widths in rad/s of the direction of generic friction.
_WIDTHS = (0.003, 0.01, 0.04)
# Prior standard deviations per N·m of noise: offset, friction, viscous friction, inertia.
_SPREAD = np.array([30.0, *[30.0] * len(_WIDTHS), 300.0, 30.0])
# Number of these columns; those of the deviations of later recordings follow.
GENERIC = len(_SPREAD)
# Columns that differ between recordings, by zeroed sensors and by temperature: offset, friction of
# the middle width, viscous friction.
CHANGING = np.array([0, 2, 4])
# Smallest noise of a joint, as a share of its RMS effort, and smallest effort, as a share of the
# largest: a joint without gravity has no effort but rounding.
_FLOOR, _SMALL = 1e-4, 0.1
# Rows of a recording from which they are identified there.
_MIN_ROWS = 20


def start_axes(problem: Problem, effects: Sequence[Effect]) -> UnknownLengths:
    """
    Return the axes and moments of the best of a few searches.

    Each is estimated together with the effects that are common in joints, because generic friction
    may hide a wrong axis.

    :raises FitError: if there are no samples.
    """
    few = _thinned(problem, _ROWS)
    candidates: list[ArmState] = []
    for seed, share in enumerate(_SHARES):
        rough = arm_problem(*generic_poses(problem, _POSES, share))
        each = search(rough, _STARTS, seed)
        if not any(_are_same(each, other, rough.q) for other in candidates):
            candidates.append(each)
    best = min((with_common_terms(few, UnknownLengths.of(in_frames_of_axes(each.chain)), effects)
                for each in candidates), key=_log_noise)
    # Gravity does not depend on the direction of a vertical first axis, the torque of motion does.
    reversed_ = best.on(UnknownLengths.of(_axes_of(best).chain.with_first_reversed()),
                        best.posterior.precision, is_known=False)
    return _axes_of(min(best, gauss_newton(reversed_, renewed=True)[0], key=_log_noise))


def _are_same(one: ArmState, other: ArmState, q: FloatArray) -> bool:
    """Return whether the gravity of two fits differs by less than the noise of the better one."""
    change = np.sqrt(((one.chain.torque(q) - other.chain.torque(q)) ** 2).mean(axis=0))
    return bool((change < np.minimum(one.noise, other.noise)).all())


def _axes_of(fit: Linear) -> UnknownLengths:
    assert isinstance(fit.shared, UnknownLengths)
    return fit.shared


def _thinned(problem: Problem, count: int) -> Problem:
    """Return the problem of evenly picked rows, at most `count`."""
    rows = problem.rows
    if rows.n_rows <= count:
        return problem
    picked = spread_over(rows.n_rows, count)
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

    They are offset, friction of several widths, viscous friction and inertia, then the deviations
    of those that change in later recordings.

    :param count: number of rows, evenly picked among those with the least motion.
    :param share: of the rows with the least motion, by |qdd| + qd^2 of all joints.
    """
    mean, samples = problem.rows.mean, problem.samples
    q, qd, qdd = (mean(x) for x in (samples.q, samples.qd, problem.motion.qdd))
    motion = (np.abs(qdd) + qd ** 2).sum(axis=1)
    slow = np.flatnonzero(motion <= np.quantile(motion, share))
    rows = slow[spread_over(len(slow), count)]
    q, qd, qdd = q[rows], qd[rows], qdd[rows]
    columns = np.stack([np.ones(qd.shape), *(np.tanh(qd / width) for width in _WIDTHS), qd, qdd])
    later = [own[:, None] * columns[k]
             for own in _later_recordings(problem.rows.run[rows]) for k in CHANGING]
    spread = np.concatenate([_SPREAD, np.resize(_SPREAD[CHANGING], len(later))])
    poses = JointSamples(samples.names, problem.rows.t[rows], q, qd, problem.y[rows],
                         problem.rows.run[rows], samples.run_labels)
    return poses, Nuisance(np.stack([*columns, *later]).transpose(2, 0, 1), spread)


def arm_problem(poses: JointSamples, nuisance: Nuisance) -> ArmProblem:
    """
    Return the problem of one arm's gravity in poses with nuisance columns.

    :raises FitError: if there are no samples.
    """
    if not poses.n_samples:
        raise FitError('no samples to fit')
    rms = np.sqrt((poses.tau ** 2).mean(axis=0))
    return ArmProblem(poses.q, poses.tau, nuisance,
                      _FLOOR * np.maximum(rms, _SMALL * rms.max()) + 1e-9)


def _later_recordings(runs: IntArray) -> list[BoolArray]:
    """Return the masks (M,) of the recordings after the first one that have enough rows."""
    numbers, counts = np.unique(runs, return_counts=True)
    return [runs == number for number in numbers[counts >= _MIN_ROWS][1:]]
