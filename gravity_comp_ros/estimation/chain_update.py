"""
A chain after a tool change: the axes stay, a few moments jump.

A payload of mass m adds m times the distance to the next joint to the moment of every link, and
its own first moment to that of the last. Which of a link's two moments that meets follows from
the kinematics, which nobody has told; on an arm with right angles it is one of the two or none,
so that the change is sparse. The axes move within their uncertainty alone.

An axis that nothing showed before (a last link without a moment of its own) shows once a tool
hangs on it. It is tried along each axis of the frame before it, and anywhere; the evidence says
which.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain import aligned, Chain
from gravity_comp_ros.models.kinematic.right_angles import right_angles_kept, TOLERANCE
from gravity_comp_ros.models.sparse.sparse_change import (
    average_change, Change, ChangeProblem, find_change)
import numpy as np

# An axis that is less sure than this (rad) was not seen.
_UNSEEN = 0.3
# How many unseen axes are tried together; more than two would multiply the trials.
_TOGETHER = 2
_DIRECTIONS = ((0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
_ROUNDS = 8
# An axis turns by no more than this in one round, rad.
_LONGEST_TURN = 0.5
# The change stays when no torque moves by more than this share of its noise.
_STAYS = 0.05
# A moment that acts less than this share of the most effective one cannot be seen to change.
_VISIBLE = 1e-3
# By how much (chi^2) a change of all moments must fit better than a sparse one to be taken.
_MUCH = 40.0


@dataclass(frozen=True)
class NewSamples:
    """Poses `q` (M, N) in rad, torques `tau` (M, N) and their noise `sigma` (N,) in N·m."""

    q: FloatArray
    tau: FloatArray
    sigma: FloatArray

    def residual(self, chain: Chain) -> FloatArray:
        """Return what a chain leaves over, in units of the noise, shape (N M,)."""
        return np.asarray(((self.tau - chain.torque(self.q)) / self.sigma).T.ravel())

    def columns(self, chain: Chain) -> FloatArray:
        """Return d torque / d step, in units of the noise, shape (4N, N M)."""
        jacobian = chain.jacobian(self.q) / self.sigma[:, None]
        return np.asarray(jacobian.reshape(len(jacobian), -1))


@dataclass(frozen=True)
class ChainChange:
    """The chain with its new moments, the covariance of a step from it, and what changed."""

    chain: Chain
    covariance: FloatArray
    change: Change


def update_chain(chain: Chain, covariance: FloatArray, new: NewSamples) -> ChainChange:
    """
    Return the chain that a sparse change of moments makes of `chain`.

    :param covariance: of a step from the chain (4N, 4N).
    """
    found = [_Hypothesis(start, prior, new) for start, prior in _hypotheses(chain, covariance)]
    best = max(found, key=lambda each: each.log_evidence).averaged()
    return _all_moments(chain, covariance, new, best)


def _all_moments(chain: Chain, covariance: FloatArray, new: NewSamples,
                 best: ChainChange) -> ChainChange:
    """
    Return the change of all moments on the same axes where a sparse one explains much less.

    The moments are a ridge regression about the old ones; the prior is as wide as the change of
    the torques. Each of the 2N moments costs ln(M) of chi^2, as in BIC.
    """
    n = chain.n_joints
    columns, residual = new.columns(chain)[2 * n:], new.residual(chain)
    size = max(float(np.abs(new.tau - chain.torque(new.q)).max()), 1e-9)
    precision = columns @ columns.T + np.diag(np.full(2 * n, size ** -2))
    inverse = np.asarray(np.linalg.inv(precision))
    step = np.concatenate([np.zeros(2 * n), inverse @ (columns @ residual)])
    moved = chain.moved(step)
    left, sparse = new.residual(moved), new.residual(best.chain)
    price = 2 * n * np.log(max(len(new.q), 2)) + _MUCH
    if float(left @ left) + price >= float(sparse @ sparse):
        return best
    spread = covariance.copy()
    spread[2 * n:], spread[:, 2 * n:] = 0.0, 0.0
    spread[2 * n:, 2 * n:] = inverse
    support = 2 * n + np.flatnonzero(np.abs(step[2 * n:]) > 0.0)
    return ChainChange(moved, spread, replace(best.change, support=support))


def _hypotheses(chain: Chain, covariance: FloatArray) -> list[tuple[Chain, FloatArray]]:
    """Return the chain with its unseen axes put along every axis, and as they are."""
    spread = np.sqrt(np.diag(covariance)[:2 * chain.n_joints].reshape(-1, 2))
    known_moment = np.abs(chain.moments).max(axis=1) > 0.0
    unseen = [j for j in range(1, chain.n_joints)
              if spread[j].min() > _UNSEEN and not known_moment[j]][-_TOGETHER:]
    trials = [(chain, covariance)]
    for directions in product(_DIRECTIONS, repeat=len(unseen)) if unseen else []:
        axes, prior = chain.axes.copy(), covariance.copy()
        for j, direction in zip(unseen, directions):
            axes[j] = aligned(np.array(direction, dtype=np.float64))
            here = slice(2 * j, 2 * j + 2)
            prior[here], prior[:, here] = 0.0, 0.0
        start = Chain(axes, chain.moments)
        square = prior.copy()
        for j in unseen:
            prior[[2 * j, 2 * j + 1], [2 * j, 2 * j + 1]] = 1.0
            square[[2 * j, 2 * j + 1], [2 * j, 2 * j + 1]] = TOLERANCE ** 2
        trials += [(start, square), (start, prior)]
    return trials


class _Hypothesis:
    """A chain before the change, and the likeliest change of it, linearised where that ends."""

    def __init__(self, chain: Chain, prior: FloatArray, new: NewSamples) -> None:
        self.chain, self.prior, self.new = chain, prior, new
        self.step = np.zeros(4 * chain.n_joints)
        self.here, self.left = chain, new.residual(chain)
        # A moment acts with its full size in some pose: it jumps by about what torques did.
        self.size = float(np.abs(new.tau - chain.torque(new.q)).max())
        change = None
        for _ in range(_ROUNDS):
            problem = self._problem()
            change = find_change(problem)
            if self._moved(self._kept(change), problem):
                break
        assert change is not None
        # Where the rounds ran out before the chain was straight enough, the evidence is of a
        # line that the chain does not follow; the true misfit counts.
        mean = self._kept(change)
        straight = problem.residual - mean @ problem.columns
        bent = new.residual(chain.moved(mean))
        self.log_evidence = change.log_evidence - 0.5 * float(bent @ bent - straight @ straight)

    def averaged(self) -> ChainChange:
        """Return the chain of the average over supports."""
        problem = self._problem()
        change = average_change(problem)
        self._moved(self._kept(change), problem)
        return ChainChange(self.here, change.covariance, change)

    def _kept(self, change: Change) -> FloatArray:
        return right_angles_kept(change.mean, change.covariance, self.prior)

    def _problem(self) -> ChangeProblem:
        columns = self.new.columns(self.here)
        n = self.chain.n_joints
        lengths = np.linalg.norm(columns[2 * n:], axis=1)
        visible = np.flatnonzero(lengths > _VISIBLE * lengths.max())
        return ChangeProblem(columns, self.left + self.step @ columns, self.prior,
                             2 * n + visible, self.size)

    def _moved(self, target: FloatArray, problem: ChangeProblem) -> bool:
        """Go to a step, or part of the way if it is far; return whether this was the last."""
        n = self.chain.n_joints
        move = target - self.step
        share = min(1.0, _LONGEST_TURN / max(float(np.abs(move[:2 * n]).max()), 1e-300))
        self.step = self.step + share * move
        self.here = self.chain.moved(self.step)
        self.left = self.new.residual(self.here)
        return share == 1.0 and bool(np.abs(move @ problem.columns).max() < _STAYS)
