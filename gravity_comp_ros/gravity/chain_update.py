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

from dataclasses import dataclass
from itertools import product

from gravity_comp_ros.gravity.chain import aligned, Chain
from gravity_comp_ros.gravity.chain_angles import TOLERANCE
from gravity_comp_ros.gravity.change import Change, ChangeProblem, find_change
from gravity_comp_ros.samples import FloatArray
import numpy as np

# An axis that is less sure than this (rad) was not seen.
_UNSEEN = 0.3
# How many unseen axes are tried together; more than two would multiply the trials.
_TOGETHER = 2
_DIRECTIONS = ((0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
# A moment is rather left alone than changed: one in three.
_LOG_ODDS = -np.log(2.0)
_ROUNDS = 8
# An axis turns by no more than this in one round, rad.
_LONGEST_TURN = 0.5
# The change stays when no torque moves by more than this share of its noise.
_STAYS = 0.05


@dataclass(frozen=True)
class ChainChange:
    """The chain with its new moments, the covariance of a step from it, and what changed."""

    chain: Chain
    covariance: FloatArray
    change: Change
    log_evidence: float
    cost: float


def update_chain(chain: Chain, covariance: FloatArray, q: FloatArray, tau: FloatArray,
                 sigma: FloatArray) -> ChainChange:
    """
    Return the chain that a sparse change of moments makes of `chain`.

    :param covariance: of a step from the chain (4N, 4N).
    :param q: new poses (M, N) in rad. :param tau: torques (M, N). :param sigma: noise (M, N).
    """
    found = [_from(start, prior, q, tau, sigma)
             for start, prior in _hypotheses(chain, covariance)]
    return max(found, key=lambda each: each.log_evidence)


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


def _from(chain: Chain, prior: FloatArray, q: FloatArray, tau: FloatArray,
          sigma: FloatArray) -> ChainChange:
    """Linearise, find the change, and again from there, until the change stays."""
    n = chain.n_joints
    may_change = np.arange(2 * n, 4 * n)
    size = np.full(2 * n, float(np.abs(tau).max()))
    step, here = np.zeros(4 * n), chain
    left = _residual(here, q, tau, sigma)
    for _ in range(_ROUNDS):
        columns = (here.jacobian(q) / sigma.T).reshape(4 * n, -1)
        target = left + step @ columns
        change = find_change(ChangeProblem(columns, target, prior, may_change, size,
                                           np.full(2 * n, _LOG_ODDS),
                                           np.ones(2 * n, dtype=bool)))
        move = change.mean - step
        share = min(1.0, _LONGEST_TURN / max(float(np.abs(move[:2 * n]).max()), 1e-300))
        step = step + share * move
        here = chain.moved(step)
        left = _residual(here, q, tau, sigma)
        if share == 1.0 and np.abs(move @ columns).max() < _STAYS:
            break
    # Where the rounds ran out before the chain was straight enough, the evidence is of a line
    # that the chain does not follow; the true misfit counts.
    cost, straight = float(left @ left), float(((target - step @ columns) ** 2).sum())
    log_evidence = change.log_evidence - 0.5 * (cost - straight)
    return ChainChange(here, change.covariance, change, log_evidence, cost)


def _residual(chain: Chain, q: FloatArray, tau: FloatArray, sigma: FloatArray) -> FloatArray:
    return np.asarray(((tau - chain.torque(q)) / sigma).T.ravel())
