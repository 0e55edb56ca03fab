"""
Start of the axes of an arm without a description.

The likelihood has several maxima. A search from random axes, with generic friction, an offset, a
spring and own inertia of each joint, finds the best one. A wrong one has several times its
residual, unless the motion is short: those near the best are compared by the evidence of the
arm's own dynamics, with right angles where these are more probable.
"""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.samples import BoolArray, IntArray, JointSamples, spread_over
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.models.kinematic.arm_solver import ArmProblem, maxima, Nuisance
from gravity_comp_ros.models.kinematic.chain import in_frames_of_axes
from gravity_comp_ros.regression.linear import Linear, with_common_terms, with_exact_angles
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.unknown_lengths import UnknownLengths
import numpy as np

# Number of starts of the search, and of poses.
_STARTS, _POSES = 72, 400
# Widths in rad/s of the direction of generic friction.
_WIDTHS = (0.003, 0.01, 0.04)
# Prior standard deviations per N·m of noise: offset, friction, viscous friction, inertia.
_SPREAD = np.array([30.0, *[30.0] * len(_WIDTHS), 300.0, 30.0])
# That of the stiffness of a spring.
_STIFFNESS = 30.0
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
    Return axes and moments, estimated together with the effects that are common in joints.

    :raises FitError: if there are no samples.
    """
    poses, nuisance = generic_poses(problem, _POSES)
    springs = poses.q - poses.q.mean(axis=0)
    found = maxima(arm_problem(poses, nuisance.with_column(springs, _STIFFNESS)), _STARTS)
    axes = [UnknownLengths.of(in_frames_of_axes(state.chain)) for state in found]
    return _most_probable(problem.coarser(_POSES), axes, effects)


def _most_probable(problem: Problem, starts: list[UnknownLengths],
                   effects: Sequence[Effect]) -> UnknownLengths:
    """Return the axes of largest evidence, compared with exact angles if there are several."""
    fits = [with_common_terms(problem, start, effects) for start in starts]
    if len(fits) == 1:
        return _axes_of(fits[0])
    best = max(map(with_exact_angles, fits), key=_log_evidence)
    return UnknownLengths.of(_axes_of(best).chain)


def _log_evidence(fit: Linear) -> float:
    """Return the log evidence with the density of the noise at its most probable size."""
    posterior = fit.posterior
    density = 0.5 * posterior.design.n_rows * float(np.log(posterior.precision).sum())
    return posterior.log_evidence + density


def _axes_of(fit: Linear) -> UnknownLengths:
    assert isinstance(fit.shared, UnknownLengths)
    return fit.shared


def generic_poses(problem: Problem, count: int) -> tuple[JointSamples, Nuisance]:
    """
    Return means over rows as samples, and the generic columns of each joint.

    They are offset, friction of several widths, viscous friction and inertia, then the deviations
    of those that change in later recordings.

    :param count: number of rows, evenly picked.
    """
    mean, samples = problem.rows.mean, problem.samples
    q, qd, qdd = (mean(x) for x in (samples.q, samples.qd, problem.motion.qdd))
    rows = spread_over(problem.rows.n_rows, count)
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
