"""
Search for the kinematic order of an arm's joints from its torques.

The residual of a serial chain is several times larger with its joints in a wrong order. A chain
is therefore fitted to a few samples in one order after another. The first order is by decreasing
torque; joints are then moved and swapped as long as the residual falls. Joints without gravity
torque, such as a vertical first joint or the last one, have no identifiable position.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.models.kinematic.arm_solver import ArmProblem
from gravity_comp_ros.models.kinematic.chain_search import search
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.start import arm_problem, generic_poses
import numpy as np

Order = tuple[int, ...]

# Maximum number of samples of a trial, and its number of starts: for the right order every other
# start converges to the right axes, and a start takes 20 ms.
_MAX_SAMPLES, _STARTS = 60, 8
# Smallest noise of a joint, as a share of the largest RMS torque.
_NOISE_SHARE = 0.05
# Maximum ratio of squared residuals for which an order is better than the last one, and for which
# it replaces the recorded one.
_BETTER, _CLEARLY_BETTER = 0.9, 0.5
# Maximum number of trials: an arm of seven joints takes 70.
_MAX_TRIALS = 200


def joint_order_from_torques(samples: JointSamples) -> tuple[str, ...] | None:
    """
    Return the joints from the base outwards, in the order that explains their torques.

    None if the residual of the samples' own order is similar.

    :param samples: slow motion, or motion of any speed.
    :raises FitError: if there are no samples.
    """
    problem = _problem(samples)
    recorded_cost = _cost(problem, tuple(range(samples.n_joints)))
    size = (samples.tau - samples.tau.mean(axis=0)).std(axis=0)
    order, cost = _local_minimum(problem, tuple(np.argsort(-size).tolist()))
    if cost > _CLEARLY_BETTER * recorded_cost:
        return None
    return tuple(samples.names[k] for k in order)


def _local_minimum(problem: ArmProblem, order: Order) -> tuple[Order, float]:
    """Return an order that no move improves, and its squared residual."""
    cost, moves = _cost(problem, order), _moves(order)
    for _ in range(1, _MAX_TRIALS):
        moved = next(moves, None)
        if moved is None:
            break
        moved_cost = _cost(problem, moved)
        if moved_cost < _BETTER * cost:
            order, cost, moves = moved, moved_cost, _moves(moved)
    return order, cost


def _problem(samples: JointSamples) -> ArmProblem:
    poses, nuisance = generic_poses(Problem.of(samples), _MAX_SAMPLES)
    size = float(np.sqrt((poses.tau ** 2).mean(axis=0)).max())
    return replace(arm_problem(poses, nuisance),
                   floor=np.full(poses.n_joints, max(_NOISE_SHARE * size, 1e-9)))


def _cost(problem: ArmProblem, order: Order) -> float:
    """Return the squared residual of the best chain with its joints in this order."""
    return float((search(problem.of_joints(list(order)), _STARTS).residual ** 2).sum())


def _moves(order: Order) -> Iterator[Order]:
    """Yield orders with one joint moved or two swapped, short distances first."""
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
