"""
Known axes of an arm against the torques of a recording: reversed directions, other zeros, order.

Gravity torque is linear in two moments of each link (`models.kinematic.chain`). They are fitted
with the axes as known, and with one joint reversed or shifted by a quarter turn after another. A
payload changes the moments only.

The kinematic order of the joints shows in the torques too: the residual of a serial chain is
several times larger in a wrong order. A chain is fitted to a few samples in one order after
another. The first order is by decreasing torque; joints are then moved and swapped as long as the
residual falls. Joints without gravity torque, such as a vertical first joint or the last one, have
no identifiable position.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import pi

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.estimation.arm_fit import ArmFit
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.arm_solver import ArmProblem, search
from gravity_comp_ros.models.kinematic.chain import about, ForwardKinematics
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.start import arm_problem, generic_poses
import numpy as np

_SHIFTS = (pi / 2, -pi / 2, pi)
# Ratio of squared residuals up to which two changes are equally good.
_EQUAL = 1.02
_Z = np.array([0.0, 0.0, 1.0])
_HALF_TURN = about(np.array([1.0, 0.0, 0.0]), pi)
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


def axis_facts(fit: ArmFit, rotations: FloatArray, earlier: GravityModel | None = None,
               options: FactOptions = FactOptions()) -> list[Fact]:
    """
    Return the facts on joints whose direction or zero contradicts known axes.

    :param fit: of samples with the joints of the axes, in their order.
    :param rotations: from frame i to frame i-1 at zero, z being the axis (N, 3, 3).
    :param earlier: the model from which the axes are known; None for a description.
    """
    names, n = fit.poses.names, fit.poses.n_joints
    changes = [each for each in _changes(n) if earlier is None or _known(
        earlier, _changed(rotations, *each), fit.q)]
    signs, zeros = np.ones(n), np.zeros(n)
    error = _misfit(fit, rotations)
    others: list[str] = []
    for _ in range(n):
        trials = [(sign * signs, zeros + shift) for sign, shift in changes]
        errors = np.array([_misfit(fit, _changed(rotations, *trial)) for trial in trials])
        if errors.min(initial=np.inf) > options.better * error:
            break
        # Reversals come first: a shift of half a turn of the joint before may have equal torques.
        equal = np.flatnonzero(errors <= _EQUAL * errors.min())
        others += [_words(names, *changes[k]) for k in equal[1:]]
        error, (signs, zeros) = float(errors[equal[0]]), trials[equal[0]]
    source = 'the description' if earlier is None else 'the earlier model'
    also = f'; equal torques: {" or ".join(others)}' if others else ''
    reversed_ = tuple(name for name, sign in zip(names, signs) if sign < 0)
    shifted = {name: float(zero) for name, zero in zip(names, zeros) if zero}
    shifts = ','.join(f'{name}={zero:.4f}' for name, zero in shifted.items())
    facts = []
    if reversed_:
        facts.append(_fact(
            reversed_, f'{", ".join(reversed_)} turns against its axis in {source}',
            'position, velocity and effort have the opposite sign',
            f'--reverse {",".join(reversed_)}{also}'))
    if shifted:
        facts.append(_fact(
            tuple(shifted), f'{", ".join(shifted)} has another zero than in {source}',
            'it is shifted by about a quarter or half turn', f'--zero {shifts}{also}', shifted))
    return facts


def _fact(names: tuple[str, ...], evidence: str, done: str, option: str,
          values: dict[str, float] | None = None) -> Fact:
    return Fact(Kind.AXES, names, f'{evidence}, by the torques', Action.REFUSED, done,
                f'{option}, or --accept {Kind.AXES} if the axes are right', values or {})


def _changes(n: int) -> list[tuple[FloatArray, FloatArray]]:
    """Return factors of the directions and shifts of zero of one joint: reversals first."""
    one = np.eye(n)
    return [*((1.0 - 2.0 * joint, 0.0 * joint) for joint in one),
            *((1.0 + 0.0 * joint, shift * joint) for joint in one for shift in _SHIFTS)]


def _words(names: tuple[str, ...], signs: FloatArray, zeros: FloatArray) -> str:
    """Return the option for the change of one joint."""
    n = int(np.argmax((signs < 0.0) | (zeros != 0.0)))
    return f'--reverse {names[n]}' if signs[n] < 0.0 else f'--zero {names[n]}={zeros[n]:.4f}'


def _changed(rotations: FloatArray, signs: FloatArray, zeros: FloatArray) -> FloatArray:
    """Return the axes on which q has the torques that signs (q - zeros) has on `rotations`."""
    changed = rotations.copy()
    for n, (sign, zero) in enumerate(zip(signs, zeros)):
        changed[n] = changed[n] @ about(_Z, -sign * zero)
        if sign < 0.0:
            changed[n] = changed[n] @ _HALF_TURN
            if n + 1 < len(changed):
                changed[n + 1] = _HALF_TURN.T @ changed[n + 1]
    return changed


def _misfit(fit: ArmFit, axes: FloatArray) -> float:
    """Return the squared residual of moments on these axes, as a share of the efforts."""
    scale = np.maximum(fit.size, 0.05 * fit.size.max())[:, None]
    columns = fit.whitened(ForwardKinematics(axes, fit.q).moment_columns())
    return float((_residual(columns / scale, fit.y / scale) ** 2).sum())


def _known(model: GravityModel, changed: FloatArray, q: FloatArray) -> bool:
    """
    Return whether an earlier model contradicts changed axes, with any moments on them.

    Axes at the end of an arm are known only if its links have weight there, and a payload is
    attached there.

    :param q: poses (M, N), limited to those of the model.
    """
    assert model.chain is not None
    q = np.clip(q, model.coverage.q_min, model.coverage.q_max)
    noise = model.noise_with_nuisance[:, None]
    columns = ForwardKinematics(changed, q).moment_columns() / noise
    residual = _residual(columns, model.chain.torque(q).T / noise)
    return bool((residual ** 2).mean(axis=1).max() > 1.0)


def _residual(columns: FloatArray, torque: FloatArray) -> FloatArray:
    """Return the part of a torque (N, M) that no moments explain with columns (P, N, M)."""
    matrix = columns.reshape(len(columns), -1).T
    moments = np.linalg.lstsq(matrix, torque.ravel(), rcond=1e-6)[0]
    return np.asarray(torque - (matrix @ moments).reshape(torque.shape))


Order = tuple[int, ...]


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
