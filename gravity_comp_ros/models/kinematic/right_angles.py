"""
Axes at right angles: what arms are built like, taken where the data allow it.

The axes of most arms are parallel or at right angles to each other, and their base stands
level. A small motion tells those angles to a few mrad, and what is wrong with them grows outside
the motion. So each axis is asked whether it lies along an axis of the frame before it, or only
at a right angle to the joint before it: it is put there when the data make that likelier than
any other angle (the Savage-Dickey ratio: the fit lost against the range that an angle gives up).
An axis that is elsewhere by more than the data can miss stays where it is.

A moment that is 0 within its uncertainty is left out in the same way, by Akaike's criterion:
what that can do wrong is as small as what it can do right, and the model prints shorter. The last
link's moment goes together with its axis, which nothing else shows, so both must be worth it.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.models.kinematic.chain import aligned, Chain
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, Solution, solve
import numpy as np

# How exactly axes are machined and zeroed, rad: an axis taken as right-angled is known to this.
TOLERANCE = 1e-3
# An angle that is known to this many tolerances was taken as right.
_TAKEN = 1.5
# Axes further than this from a right angle are not asked, rad.
_NEAR = 0.35
# Twice the log likelihood that a moment must be worth.
_AKAIKE = 2.0
# The last link's moments and angles: the best of all directions was taken, so the price of each
# is that of a coefficient chosen among many, ln R for R rows.
_LAST_LINK = 4
# Right angles must be this much likelier (natural logarithm).
_LIKELIER = 1.0


@dataclass(frozen=True, eq=False)
class Tidy:
    """
    A solution with right angles; `square` (N,) counts each axis' angles that were taken.

    `spread` (2N,) in rad is how unsure each angle is that was taken.
    """

    solution: Solution
    square: tuple[int, ...]
    spread: FloatArray

    def covariance(self) -> FloatArray:
        """
        Return how unsure a step from the chain is, shape (4N, 4N).

        Angles that were taken are known to `spread`; moments that were left out keep the
        uncertainty that made it possible to leave them out.
        """
        n = self.solution.chain.n_joints
        precision = self.solution.precision.copy()
        held = np.flatnonzero(~self.solution.free[:2 * n])
        precision[held, held] += self.spread[held] ** -2
        return np.asarray(np.linalg.inv(precision))


def tidy(problem: ChainProblem, solution: Solution) -> Tidy:
    """Return the solution with the right angles and without the moments that the data allow."""
    work = _Tidier(problem, solution)
    work.drop_last_links()
    square = [work.axis(j) for j in range(problem.n_joints)]
    return Tidy(drop_moments(problem, work.best), tuple(square), work.spread)


def right_angles_kept(mean: FloatArray, covariance: FloatArray, before: FloatArray) -> FloatArray:
    """
    Return the mean of a step (K,), first angles (2N,), given that right angles stay right.

    :param covariance: of the step, (K, K).
    :param before: the covariance (K, K) that it had before the new data: it tells which angles
        are right, by their being known to the exactness of an arm.
    """
    half = len(mean) // 2
    spread = np.sqrt(np.maximum(np.diag(before)[:half], 0.0))
    held = np.flatnonzero((spread > 0.0) & (spread < _TAKEN * TOLERANCE))
    given = np.linalg.pinv(covariance[np.ix_(held, held)], hermitian=True) @ mean[held]
    kept = mean - covariance[:, held] @ given
    kept[held] = 0.0
    return np.asarray(kept)


def upright(chain: Chain) -> Chain:
    """Return the same gravity with the base axis pointing up rather than down."""
    if chain.axes[0, 2, 2] >= 0.0:
        return chain
    axes = chain.axes.copy()
    axes[0] = np.diag([1.0, -1.0, -1.0]) @ axes[0]
    return Chain(axes, -chain.moments)


class _Tidier:
    """The best solution so far, tidied from the base outwards."""

    def __init__(self, problem: ChainProblem, solution: Solution) -> None:
        self.problem = problem
        self.best = self._again(upright(solution.chain), solution.free)
        # Whether all axes so far are vertical: then a turn of the rest about them is free.
        self.vertical = True
        self.spread = np.full(2 * problem.n_joints, TOLERANCE)

    def axis(self, j: int) -> int:
        """Try right angles for the axis of joint j; return how many angles were taken."""
        n = self.problem.n_joints
        self.best = self._again(in_common_frame(self.best.chain, j, self.vertical),
                                self.best.free)
        covariance = np.linalg.inv(self.best.precision)
        spread = np.hypot(TOLERANCE, np.sqrt(np.diag(covariance)[2 * j:2 * j + 2]))
        z = self.best.chain.axes[j][:, 2]
        trials = []
        if np.abs(z).max() > np.cos(_NEAR):
            along = np.where(np.arange(3) == np.abs(z).argmax(), np.sign(z), 0.0)
            trials.append((along, [0, 1]))
        if j and abs(z[2]) < np.sin(_NEAR):
            level = np.array([z[0], z[1], 0.0])
            trials.append((level / np.linalg.norm(level), [0]))
        taken, best = 0, self.best
        for direction, angles in trials:
            tried = self._turned(j, direction, angles)
            # A turn about the vertical is free, so that holding it gives nothing up.
            counted = [0] if self.vertical and direction[2] == 0.0 else angles
            gained = float(np.log(np.sqrt(np.pi / 8.0) / spread[counted]).sum())
            likelier = gained - 0.5 * (tried.cost - self.best.cost)
            if likelier > _LIKELIER:
                taken, best = len(angles), tried
                # As likely as it is that the angle is another one, it may be off by this.
                wrong = np.exp(-likelier) * np.hypot(spread[angles], np.arccos(np.clip(
                    direction @ z, -1.0, 1.0))) ** 2
                self.spread[[2 * j + k for k in angles]] = np.sqrt(TOLERANCE ** 2 + wrong)
                break
        self.best = best
        if abs(best.chain.axes[j][2, 2]) < 1.0 - 1e-9 or best.free[2 * j]:
            self.vertical = False
        elif self.vertical:
            # About a vertical axis no moment does anything.
            self.best.free[2 * n + 2 * j:2 * n + 2 * j + 2] = False
        return taken

    def drop_last_links(self) -> None:
        n = self.problem.n_joints
        for j in range(n - 1, 0, -1):
            free = self.best.free.copy()
            free[2 * j:2 * j + 2] = free[2 * n + 2 * j:2 * n + 2 * j + 2] = False
            tried = self._again(self.best.chain, free)
            if tried.cost - self.best.cost > _LAST_LINK * np.log(self.problem.tau.size):
                break
            # The axis may turn again: it is not known, only without effect.
            tried.free[2 * j:2 * j + 2] = True
            self.best = tried

    def _turned(self, j: int, direction: FloatArray, angles: list[int]) -> Solution:
        """Put axis j along `direction` of the frame before it, hold `angles`, solve."""
        axes, free = self.best.chain.axes.copy(), self.best.free.copy()
        axes[j] = _with_axis(axes[j], direction)
        free[[2 * j + k for k in angles]] = False
        return solve(self.problem, axes, free)

    def _again(self, chain: Chain, free: BoolArray) -> Solution:
        return solve(self.problem, chain.axes, free.copy())


def drop_moments(problem: ChainProblem, solution: Solution) -> Solution:
    """Return the solution without moments that are 0, the one least told from 0 first."""
    n = problem.n_joints
    free = solution.free.copy()
    covariance = np.linalg.inv(solution.precision)[2 * n:, 2 * n:]
    moments = solution.chain.moments.ravel().copy()
    count = 0
    while True:
        open_ = np.flatnonzero(free[2 * n:])
        if not open_.size:
            break
        lost = moments[open_] ** 2 / np.maximum(covariance[open_, open_], 1e-300)
        k = open_[int(np.argmin(lost))]
        if lost.min() > _AKAIKE:
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

    The common normal of an axis and the one before it is where Denavit and Hartenberg put x;
    parallel axes have none, and the frame is then carried over from the one before it.

    :param vertical: all axes before j are vertical, so that the frame may turn about them.
    """
    axes, moments = chain.axes.copy(), chain.moments.copy()
    z = axes[j][:, 2]
    sine = np.hypot(z[0], z[1])
    if vertical and sine > 0.0:
        axes[j] = _about_z(-np.arctan2(z[0], -z[1])) @ axes[j]
        if j:
            moments[j - 1] = 0.0
    wanted = _with_axis(axes[j], axes[j][:, 2]) if sine > 0.05 else aligned(axes[j][:, 2])
    turn = wanted.T @ axes[j]
    moments[j] = turn[:2, :2] @ moments[j]
    axes[j] = wanted
    if j + 1 < len(axes):
        axes[j + 1] = turn @ axes[j + 1]
    return Chain(axes, moments)


def _with_axis(frame: FloatArray, z: FloatArray) -> FloatArray:
    """Return a frame with axis z: x is level, or as near to that of `frame` as it can be."""
    if np.hypot(z[0], z[1]) > 0.05:
        x = np.array([-z[1], z[0], 0.0])
        x *= np.sign(x @ frame[:, 0]) if abs(x @ frame[:, 0]) > 0.5 else 1.0
    else:
        x = frame[:, 0] - (frame[:, 0] @ z) * z
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _about_z(angle: float) -> FloatArray:
    s, c = np.sin(angle), np.cos(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
