"""
The order of an arm's joints, found from its torques.

A chain of links explains the torques of an arm if its joints come in their order, and leaves
several times as much if they do not. So a chain is fitted to a few samples in one order after the
other. The first order is that of the size of the torques; then joints are moved and swapped as
long as that explains more. Joints that carry no gravity, such as an upright first one or the last
one, have no place of their own, and any will do.
"""

from __future__ import annotations

from collections.abc import Iterator

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.regression import build_regression
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, solve, SolveOptions
from gravity_comp_ros.models.kinematic.chain_starts import next_axes
import numpy as np

Order = tuple[int, ...]

# Samples of a trial, and starts of each: every other start of a right order ends in the right
# axes, and a start takes 20 ms.
_FEW, _STARTS = 60, 8
_QUICK = SolveOptions(max_steps=20, tolerance=1e-3)
# Weights are 1 over this part of the largest torque.
_FIRST = 0.05
# An order is better if it leaves this part of the squared residual, and is taken in place of the
# recorded one if it leaves this part of that one's.
_BETTER, _CLEARLY_BETTER = 0.9, 0.5
# Orders that are tried at most: an arm of seven joints takes 70.
_MOST_TRIED = 200


def order_of_torques(samples: JointSamples) -> tuple[str, ...] | None:
    """
    Return the joints from the base outwards, in the order that explains their torques.

    None if the order of the samples explains them about as well.

    :param samples: slow motion, or motion of any speed.
    :raises FitError: if there are no samples.
    """
    problem = _problem(samples)
    recorded = _left(problem, tuple(range(samples.n_joints)))
    size = (samples.tau - samples.tau.mean(axis=0)).std(axis=0)
    order, left = _improved(problem, tuple(np.argsort(-size).tolist()))
    if left > _CLEARLY_BETTER * recorded:
        return None
    return tuple(samples.names[k] for k in order)


def _improved(problem: ChainProblem, order: Order) -> tuple[Order, float]:
    """Return an order that no move improves, and the squared residual that it leaves."""
    left, moves = _left(problem, order), _moves(order)
    for _ in range(1, _MOST_TRIED):
        moved = next(moves, None)
        if moved is None:
            break
        found = _left(problem, moved)
        if found < _BETTER * left:
            order, left, moves = moved, found, _moves(moved)
    return order, left


def _problem(samples: JointSamples) -> ChainProblem:
    regression = build_regression(samples).thinned(_FEW)
    few, beside = regression.samples, regression.beside()
    weight = 1.0 / max(_FIRST * float(np.sqrt((few.tau ** 2).mean(axis=0)).max()), 1e-9)
    return ChainProblem(few.q, few.tau, np.full(few.tau.shape, weight), beside.columns,
                        beside.spread)


def _left(problem: ChainProblem, order: Order) -> float:
    """Return the squared residual of the best chain with its joints in this order."""
    places = list(order)
    nuisance = None if problem.nuisance is None else problem.nuisance[:, places]
    ordered = ChainProblem(problem.q[:, places], problem.tau[:, places],
                           problem.weights[:, places], nuisance, problem.spread)
    rng = np.random.default_rng(0)
    best = solve(ordered, next_axes(rng, len(order), 1, None), options=_QUICK)
    for count in range(2, _STARTS + 1):
        found = solve(ordered, next_axes(rng, len(order), count, best), options=_QUICK)
        best = min(best, found, key=lambda solution: solution.cost)
    return best.cost


def _moves(order: Order) -> Iterator[Order]:
    """Yield orders with one joint moved or two swapped, near places first."""
    n, seen = len(order), {order}
    for distance in range(1, n):
        for joint in range(n):
            for place in (joint - distance, joint + distance):
                if not 0 <= place < n:
                    continue
                moved, swapped = list(order), list(order)
                moved.insert(place, moved.pop(joint))
                swapped[joint], swapped[place] = swapped[place], swapped[joint]
                for other in (tuple(moved), tuple(swapped)):
                    if other not in seen:
                        seen.add(other)
                        yield other
