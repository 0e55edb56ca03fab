"""
Axes of a robot description against the torques: reversed directions of joints, and other zeros.

Gravity torque is linear in three lumped moments of each link, whatever the lengths of the links
are: tau_k = sum over j >= k of g . (a_k x R_j h_j), with the axis a_k and the rotation R_j of
link j. It is fitted with the axes as described, and with one joint reversed or shifted by a
quarter turn after another.
"""

from __future__ import annotations

from math import pi

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.facts.options import FactOptions
import numpy as np

_MAX_SAMPLES = 200
# rad/s. Slower motion has little torque of inertia.
_SLOW = 0.3
_SHIFTS = (pi / 2, -pi / 2, pi)
# Ratio of squared residuals up to which two changes are equally good.
_EQUAL = 1.02


def axis_facts(samples: JointSamples, rotations: FloatArray,
               options: FactOptions = FactOptions()) -> list[Fact]:
    """
    Return the facts on joints whose direction or zero contradicts the described axes.

    :param samples: with the joints of the description, in its order.
    :param rotations: from frame i to frame i-1 at zero, z being the axis (N, 3, 3).
    """
    rows = np.flatnonzero((np.abs(samples.qd) < _SLOW).all(axis=1))
    if len(rows) < options.min_samples:
        return []
    slow = samples.select(rows[::-(-len(rows) // _MAX_SAMPLES)])
    signs, zeros = np.ones(samples.n_joints), np.zeros(samples.n_joints)
    error = _misfit(slow, rotations, signs, zeros)
    others: list[str] = []
    for _ in range(samples.n_joints):
        trials = _trials(signs, zeros)
        errors = np.array([_misfit(slow, rotations, *trial) for trial in trials])
        if errors.min() > options.better_axes * error:
            break
        # Reversals come first: a shift of half a turn of the joint before may have equal torques.
        equal = np.flatnonzero(errors <= _EQUAL * errors.min())
        others += [_words(samples.names, signs, zeros, trials[k]) for k in equal[1:]]
        error, (signs, zeros) = float(errors[equal[0]]), trials[equal[0]]
    return _facts(samples.names, signs, zeros, others)


def _trials(signs: FloatArray, zeros: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return directions and zeros of which one differs: reversals first, then shifts."""
    trials = []
    for n in range(len(signs)):
        reversed_ = signs.copy()
        reversed_[n] *= -1.0
        trials.append((reversed_, zeros))
    for n in range(len(signs)):
        for shift in _SHIFTS:
            shifted = zeros.copy()
            shifted[n] += shift
            trials.append((signs, shifted))
    return trials


def _words(names: tuple[str, ...], signs: FloatArray, zeros: FloatArray,
           trial: tuple[FloatArray, FloatArray]) -> str:
    """Return the options for the changes of a trial."""
    changed = np.flatnonzero(trial[0] != signs)
    if changed.size:
        return f'--reverse {names[changed[0]]}'
    shifted = int(np.flatnonzero(trial[1] != zeros)[0])
    return f'--zero {names[shifted]}={trial[1][shifted]:.4f}'


def _facts(names: tuple[str, ...], signs: FloatArray, zeros: FloatArray,
           others: list[str]) -> list[Fact]:
    reversed_ = tuple(name for name, sign in zip(names, signs) if sign < 0)
    shifted = {name: float(zero) for name, zero in zip(names, zeros) if zero}
    also = f'; equal torques: {" or ".join(others)}' if others else ''
    facts = []
    if reversed_:
        facts.append(Fact(
            Kind.AXES, reversed_, f'{", ".join(reversed_)} turns against its axis in the '
            f'description, by the torques', Action.NOTED, 'position, velocity and effort have the '
            'opposite sign', f'--reverse {",".join(reversed_)}{also}'))
    if shifted:
        values = ','.join(f'{name}={zero:.4f}' for name, zero in shifted.items())
        facts.append(Fact(
            Kind.AXES, tuple(shifted), f'{", ".join(shifted)} has another zero than in the '
            f'description, by the torques', Action.NOTED, 'it is shifted by about a quarter or '
            'half turn', f'--zero {values}{also}', shifted))
    return facts


def _misfit(samples: JointSamples, rotations: FloatArray, signs: FloatArray,
            zeros: FloatArray) -> float:
    """Return the squared residual of gravity and friction with these directions and zeros."""
    columns = gravity_columns(signs * (samples.q - zeros), rotations)
    scale = np.maximum(samples.tau.std(axis=0), 0.05 * samples.tau.std(axis=0).max() + 1e-9)
    parts, values = [], []
    for n in range(samples.n_joints):
        speed = samples.qd[:, n]
        fastest = max(float(np.abs(speed).max()), 1e-9)
        friction = np.column_stack([np.tanh(speed / (0.05 * fastest)), np.sign(speed),
                                    speed / fastest])
        basis = np.linalg.qr(friction)[0]
        both = np.column_stack([columns[:, n], signs[n] * samples.tau[:, n]]) / scale[n]
        both = both - basis @ (basis.T @ both)
        parts.append(both[:, :-1])
        values.append(both[:, -1])
    matrix, target = np.concatenate(parts), np.concatenate(values)
    residual = target - matrix @ np.linalg.lstsq(matrix, target, rcond=1e-6)[0]
    return float(residual @ residual)


def gravity_columns(q: FloatArray, rotations: FloatArray) -> FloatArray:
    """
    Return the columns of the gravity torque (M, N, 3 N) by the three moments of each link.

    :param q: angles (M, N) in rad.
    :param rotations: see `axis_facts`.
    """
    count, n_joints = q.shape
    down = np.array([0.0, 0.0, -1.0])
    frame = np.broadcast_to(np.eye(3), (count, 3, 3))
    axes, links = [], []
    for n in range(n_joints):
        frame = frame @ rotations[n]
        axes.append(frame[:, :, 2])
        c, s = np.cos(q[:, n]), np.sin(q[:, n])
        turn = np.zeros((count, 3, 3))
        turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1] = c, -s, s, c
        turn[:, 2, 2] = 1.0
        frame = frame @ turn
        links.append(frame)
    columns = np.zeros((count, n_joints, 3 * n_joints))
    for k in range(n_joints):
        lever = np.cross(down, axes[k])  # g . (a x r) = (g x a) . r
        for j in range(k, n_joints):
            columns[:, k, 3 * j:3 * j + 3] = np.einsum('mi,mij->mj', lever, links[j])
    return columns
