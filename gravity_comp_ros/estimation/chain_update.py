"""
A chain after a tool change: the axes stay, a few moments jump.

A payload of mass m adds m times the distance to the next joint to the moment of every link, and
its own first moment to that of the last. Which of a link's two moments that meets follows from
the kinematics, which are unknown; on an arm with right angles it is one of the two or none,
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
    average_change, Change, ChangeProblem, find_change, full_evidence)
import numpy as np
from scipy.special import softmax

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
# Directions of unseen axes that are followed to the end: those of the most evidence at first.
_FOLLOWED = 5
# Poses that the predictions of nearly equal hypotheses are compared at.
_COMPARED = 100
# Hypotheses with less than this share of the evidence of the likeliest one are not taken.
_UNLIKELY = 0.01
# By how much (chi^2) the average over supports may fit worse than the likeliest one.
_STRAIGHT = 10.0


@dataclass(frozen=True)
class NewSamples:
    """
    Poses `q` (M, N) in rad, torques `tau` (M, N) and their noise `sigma` (N,) in N·m.

    `trust` (M, N) weighs squared residuals: outliers count for less, or for nothing.
    """

    q: FloatArray
    tau: FloatArray
    sigma: FloatArray
    trust: FloatArray

    @property
    def row_weights(self) -> FloatArray:
        """Return one over the standard deviation of each torque, (M, N) in 1/(N·m)."""
        return np.asarray(np.sqrt(self.trust) / self.sigma)

    def residual(self, chain: Chain) -> FloatArray:
        """Return the residual of a chain in units of the noise, shape (N M,)."""
        return np.asarray(((self.tau - chain.torque(self.q)) * self.row_weights).T.ravel())

    def largest(self, chain: Chain) -> float:
        """Return the largest residual of a chain among trusted samples, in N·m."""
        return float(np.abs((self.tau - chain.torque(self.q))[self.trust > 0.0]).max(initial=0.0))

    def columns(self, chain: Chain) -> FloatArray:
        """Return d torque / d step, in units of the noise, shape (4N, N M)."""
        jacobian = chain.jacobian(self.q) * self.row_weights.T
        return np.asarray(jacobian.reshape(len(jacobian), -1))


@dataclass(frozen=True)
class ChainChange:
    """
    The chain with its new moments, the covariance of a step from it, and what changed.

    `start` is the chain with its unseen axes as they were tried, and the prior of a step from it.
    """

    chain: Chain
    covariance: FloatArray
    change: Change
    start: tuple[Chain, FloatArray]


def update_chain(chain: Chain, covariance: FloatArray, new: NewSamples, box: FloatArray,
                 start: tuple[Chain, FloatArray] | None = None,
                 path: FloatArray | None = None) -> ChainChange:
    """
    Return the chain that a sparse change of moments makes of `chain`.

    :param covariance: of a step from the chain (4N, 4N).
    :param box: lower and upper ends (2, N) in rad of the poses that it is to predict.
    :param start: that of a change found before; no others are tried then.
    :param path: change of the moments (2N,) that a payload made before (`payload_path`). Another
        payload changes them in proportion to its mass, but for those that its centre moves.
    """
    trials = _hypotheses(chain, covariance) if start is None else [start]
    if len(trials) > _FOLLOWED:
        scores = np.array([_first_evidence(*trial, new) for trial in trials])
        trials = [trials[k] for k in np.argsort(-scores)[:_FOLLOWED]]
    along = None
    if path is not None and np.abs(path).max() > 0.0:
        along = np.concatenate([np.zeros(2 * chain.n_joints), path / np.abs(path).max()])[None]
    found = [_Hypothesis(*trial, new, along) for trial in trials]
    best = found[_central(found, box)].averaged()
    return _all_moments(chain, covariance, new, best)


def _first_evidence(chain: Chain, prior: FloatArray, new: NewSamples) -> float:
    """Return the evidence of a change of all moments, linearised at a chain."""
    n = chain.n_joints
    return full_evidence(ChangeProblem(new.columns(chain), new.residual(chain), prior,
                                       np.arange(2 * n, 4 * n), new.largest(chain)))


def _central(found: list[_Hypothesis], box: FloatArray) -> int:
    """
    Return which hypothesis predicts most like all of them, each weighed by its evidence.

    Few samples often leave several directions of an axis almost equally likely. The one in their
    middle is nearer to the truth than the likeliest at the rim.
    """
    if len(found) == 1:
        return 0
    weights = softmax([each.log_evidence for each in found])
    q = np.random.default_rng(0).uniform(box[0], box[1], (_COMPARED, box.shape[1]))
    torques = np.array([each.here.torque(q) for each in found])
    distance = ((torques - np.tensordot(weights, torques, axes=1)) ** 2).sum(axis=(1, 2))
    return int(np.argmin(np.where(weights < _UNLIKELY * weights.max(), np.inf, distance)))


def _all_moments(chain: Chain, covariance: FloatArray, new: NewSamples,
                 best: ChainChange) -> ChainChange:
    """
    Return the change of all moments on the same axes where a sparse one explains much less.

    The moments are a ridge regression about the old ones; the prior is as wide as the change of
    the torques. Each of the 2N moments costs ln(M) of chi^2, as in BIC.
    """
    n = chain.n_joints
    columns, residual = new.columns(chain)[2 * n:], new.residual(chain)
    size = max(new.largest(chain), 1e-9)
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
    return ChainChange(moved, spread, replace(best.change, support=support), best.start)


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

    def __init__(self, chain: Chain, prior: FloatArray, new: NewSamples,
                 along: FloatArray | None = None) -> None:
        self.chain, self.prior, self.new, self.along = chain, prior, new, along
        self.step = np.zeros(4 * chain.n_joints)
        self.here, self.left = chain, new.residual(chain)
        # A moment acts with its full size in some pose: it jumps by about what torques did.
        self.size = new.largest(chain)
        change = None
        for _ in range(_ROUNDS):
            problem = self._problem()
            change = find_change(problem, change)
            if self._moved(self._kept(change), problem):
                break
        assert change is not None
        # Where the rounds ran out before the chain was straight enough, the evidence is of a
        # line that the chain does not follow; the true misfit counts.
        self.change = change
        mean = self._kept(change)
        straight = problem.residual - mean @ problem.columns
        bent = new.residual(chain.moved(mean))
        self.log_evidence = change.log_evidence - 0.5 * float(bent @ bent - straight @ straight)

    def averaged(self) -> ChainChange:
        """
        Return the chain of the average over supports.

        An average far from the likeliest support is no step that a chain follows: where it fits
        worse, the likeliest one is returned, with the covariance of the average.
        """
        problem = self._problem()
        likeliest, left = self.here, self.left
        change = average_change(problem, self.change)
        self._moved(self._kept(change), problem)
        here = self.here
        if float(self.left @ self.left) > float(left @ left) + _STRAIGHT:
            here = likeliest
        return ChainChange(here, change.covariance, change, (self.chain, self.prior))

    def _kept(self, change: Change) -> FloatArray:
        return right_angles_kept(change.mean, change.covariance, self.prior)

    def _problem(self) -> ChangeProblem:
        columns = self.new.columns(self.here)
        n = self.chain.n_joints
        lengths = np.linalg.norm(columns[2 * n:], axis=1)
        visible = np.flatnonzero(lengths > _VISIBLE * lengths.max())
        return ChangeProblem(columns, self.left + self.step @ columns, self.prior,
                             2 * n + visible, self.size, self.along)

    def _moved(self, target: FloatArray, problem: ChangeProblem) -> bool:
        """Go to a step, or part of the way if it is far; return whether this was the last."""
        n = self.chain.n_joints
        move = target - self.step
        share = min(1.0, _LONGEST_TURN / max(float(np.abs(move[:2 * n]).max()), 1e-300))
        self.step = self.step + share * move
        self.here = self.chain.moved(self.step)
        self.left = self.new.residual(self.here)
        return share == 1.0 and bool(np.abs(move @ problem.columns).max() < _STAYS)
