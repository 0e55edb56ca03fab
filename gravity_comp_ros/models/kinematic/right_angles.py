"""
Right angles between joint axes, adopted where the data support them.

The axes of most arms are parallel or perpendicular, and their base is level. A small motion
determines those angles to a few mrad, and the error grows outside the motion. So each axis is
compared with two hypotheses: along an axis of the frame before it, or perpendicular to the
previous joint's axis. A hypothesis is adopted if it is more probable than any other angle (the
Savage-Dickey ratio: the lost likelihood against the range of angles given up). An axis further
from a right angle than its uncertainty stays where it is.

A moment that is 0 within its uncertainty is dropped in the same way, by Akaike's criterion: the
possible harm is as small as the possible benefit, and the model prints shorter. The last link's
moment is dropped together with its axis, which is identifiable only through that moment.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.models.kinematic.chain import about_z, aligned, Chain
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, Solution, solve
import numpy as np

# Standard deviation of a machined and zeroed right angle, in rad.
TOLERANCE = 1e-3
# An angle is an adopted right angle if its std is below this multiple of the tolerance.
_ADOPTED = 1.5
# Largest distance from a right angle, in rad, at which it is tried.
_NEAR = 0.35
# Price of a moment in chi^2.
_AKAIKE = 2.0
# Number of coefficients of the last link: two moments and two angles. The best of all directions
# was selected, so each costs ln R for R rows, as a coefficient chosen among many.
_LAST_LINK = 4
# Log evidence that a right angle must gain.
_MIN_LOG_EVIDENCE = 1.0


@dataclass(frozen=True, eq=False)
class RightAngleSolution:
    """
    A solution with right angles.

    `square` (N,) counts the adopted angles of each axis; `spread` (2N,) in rad is the standard
    deviation of each adopted angle.
    """

    solution: Solution
    square: tuple[int, ...]
    spread: FloatArray

    def covariance(self) -> FloatArray:
        """
        Return the covariance (4N, 4N) of a step from the chain.

        Adopted angles have the standard deviation `spread`; dropped moments keep the uncertainty
        that allowed dropping them.
        """
        n = self.solution.chain.n_joints
        precision = self.solution.precision.copy()
        adopted = np.flatnonzero(~self.solution.free[:2 * n])
        precision[adopted, adopted] += self.spread[adopted] ** -2
        return np.asarray(np.linalg.inv(precision))


def adopt_right_angles(problem: ChainProblem, solution: Solution) -> RightAngleSolution:
    """Return the solution with right angles, and without insignificant moments."""
    search = _RightAngleSearch(problem, solution)
    search.drop_last_links()
    square = [search.axis(j) for j in range(problem.n_joints)]
    return RightAngleSolution(drop_moments(problem, search.best), tuple(square), search.spread)


def right_angles_kept(mean: FloatArray, covariance: FloatArray, before: FloatArray) -> FloatArray:
    """
    Return the mean of a step (K,), first angles (2N,), given that right angles stay right.

    :param covariance: of the step, (K, K).
    :param before: the covariance (K, K) before the new data; angles with a standard deviation near
        the tolerance are right angles.
    """
    half = len(mean) // 2
    spread = np.sqrt(np.maximum(np.diag(before)[:half], 0.0))
    adopted = np.flatnonzero((spread > 0.0) & (spread < _ADOPTED * TOLERANCE))
    shift = np.linalg.pinv(covariance[np.ix_(adopted, adopted)], hermitian=True) @ mean[adopted]
    kept = mean - covariance[:, adopted] @ shift
    kept[adopted] = 0.0
    return np.asarray(kept)


def upright(chain: Chain) -> Chain:
    """Return the same gravity with the base axis pointing up rather than down."""
    if chain.axes[0, 2, 2] >= 0.0:
        return chain
    axes = chain.axes.copy()
    axes[0] = np.diag([1.0, -1.0, -1.0]) @ axes[0]
    return Chain(axes, -chain.moments)


class _RightAngleSearch:
    """The best solution so far; axes are tried from the base outwards."""

    def __init__(self, problem: ChainProblem, solution: Solution) -> None:
        self.problem = problem
        self.best = self._refit(upright(solution.chain), solution.free)
        # Whether all axes so far are vertical: the frames after them may then rotate about them.
        self.vertical = True
        self.spread = np.full(2 * problem.n_joints, TOLERANCE)

    def axis(self, j: int) -> int:
        """Try right angles for the axis of joint j; return the number of adopted angles."""
        n = self.problem.n_joints
        self.best = self._refit(in_common_frame(self.best.chain, j, self.vertical),
                                self.best.free)
        covariance = np.linalg.inv(self.best.precision)
        spread = np.hypot(TOLERANCE, np.sqrt(np.diag(covariance)[2 * j:2 * j + 2]))
        z = self.best.chain.axes[j][:, 2]
        adopted, best = 0, self.best
        for direction, angles in _hypotheses(z, j):
            tried = self._with_right_angle(j, direction, angles)
            # Rotation about the vertical has no effect, so fixing it gives nothing up.
            counted = [0] if self.vertical and direction[2] == 0.0 else angles
            gain = float(np.log(np.sqrt(np.pi / 8.0) / spread[counted]).sum())
            log_evidence = gain - 0.5 * (tried.cost - self.best.cost)
            if log_evidence > _MIN_LOG_EVIDENCE:
                adopted, best = len(angles), tried
                # Variance of a wrong right angle: its probability times the squared error.
                wrong = np.exp(-log_evidence) * np.hypot(spread[angles], np.arccos(np.clip(
                    direction @ z, -1.0, 1.0))) ** 2
                self.spread[[2 * j + k for k in angles]] = np.sqrt(TOLERANCE ** 2 + wrong)
                break
        self.best = best
        if abs(best.chain.axes[j][2, 2]) < 1.0 - 1e-9 or best.free[2 * j]:
            self.vertical = False
        elif self.vertical:
            # Moments about a vertical axis have no torque.
            self.best.free[2 * n + 2 * j:2 * n + 2 * j + 2] = False
        return adopted

    def drop_last_links(self) -> None:
        """Drop the moments of the last links from the tip, as long as they are insignificant."""
        n = self.problem.n_joints
        for j in range(n - 1, 0, -1):
            free = self.best.free.copy()
            free[2 * j:2 * j + 2] = free[2 * n + 2 * j:2 * n + 2 * j + 2] = False
            tried = self._refit(self.best.chain, free)
            if tried.cost - self.best.cost > _LAST_LINK * np.log(self.problem.tau.size):
                break
            # The axis is free again: it has no effect, but it is not known.
            tried.free[2 * j:2 * j + 2] = True
            self.best = tried

    def _with_right_angle(self, j: int, direction: FloatArray, angles: list[int]) -> Solution:
        """Put axis j along `direction` of the frame before it, fix `angles`, solve."""
        axes, free = self.best.chain.axes.copy(), self.best.free.copy()
        axes[j] = _with_axis(axes[j], direction)
        free[[2 * j + k for k in angles]] = False
        return solve(self.problem, axes, free)

    def _refit(self, chain: Chain, free: BoolArray) -> Solution:
        return solve(self.problem, chain.axes, free.copy())


def _hypotheses(z: FloatArray, j: int) -> list[tuple[FloatArray, list[int]]]:
    """Return directions (3,) near the axis z of joint j, and the angles that each one fixes."""
    near = []
    if np.abs(z).max() > np.cos(_NEAR):
        near.append((np.where(np.arange(3) == np.abs(z).argmax(), np.sign(z), 0.0), [0, 1]))
    if j and abs(z[2]) < np.sin(_NEAR):
        level = np.array([z[0], z[1], 0.0])
        near.append((level / np.linalg.norm(level), [0]))
    return near


def drop_moments(problem: ChainProblem, solution: Solution) -> Solution:
    """Return the solution without insignificant moments, the least significant dropped first."""
    n = problem.n_joints
    free = solution.free.copy()
    covariance = np.linalg.inv(solution.precision)[2 * n:, 2 * n:]
    moments = solution.chain.moments.ravel().copy()
    count = 0
    while True:
        remaining = np.flatnonzero(free[2 * n:])
        if not remaining.size:
            break
        loss = moments[remaining] ** 2 / np.maximum(covariance[remaining, remaining], 1e-300)
        k = remaining[int(np.argmin(loss))]
        if loss.min() > _AKAIKE:
            break
        gain = covariance[:, k] / covariance[k, k]
        moments -= gain * moments[k]
        covariance = covariance - np.outer(gain, covariance[k])
        free[2 * n + k] = False
        count += 1
    tried = solve(problem, solution.chain.axes, free)
    return tried if tried.cost - solution.cost < _AKAIKE * count else solution


def in_common_frame(chain: Chain, j: int, vertical: bool) -> Chain:
    """
    Return the same gravity with the x axis of frame j along the common normal.

    The common normal of an axis and the one before it is the x axis of Denavit and Hartenberg;
    parallel axes have none, and keep the frame of the axis before.

    :param vertical: all axes before j are vertical, so that the frame may rotate about them.
    """
    axes, moments = chain.axes.copy(), chain.moments.copy()
    z = axes[j][:, 2]
    sine = np.hypot(z[0], z[1])
    if vertical and sine > 0.0:
        axes[j] = about_z(-np.arctan2(z[0], -z[1])) @ axes[j]
        if j:
            moments[j - 1] = 0.0
    frame = _with_axis(axes[j], axes[j][:, 2]) if sine > 0.05 else aligned(axes[j][:, 2])
    rotation = frame.T @ axes[j]
    moments[j] = rotation[:2, :2] @ moments[j]
    axes[j] = frame
    if j + 1 < len(axes):
        axes[j + 1] = rotation @ axes[j + 1]
    return Chain(axes, moments)


def _with_axis(frame: FloatArray, z: FloatArray) -> FloatArray:
    """Return a frame with axis z: its x axis is level, or as near as possible to `frame`'s."""
    if np.hypot(z[0], z[1]) > 0.05:
        x = np.array([-z[1], z[0], 0.0])
        x *= np.sign(x @ frame[:, 0]) if abs(x @ frame[:, 0]) > 0.5 else 1.0
    else:
        x = frame[:, 0] - (frame[:, 0] @ z) * z
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
