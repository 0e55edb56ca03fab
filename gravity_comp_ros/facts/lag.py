"""Efforts behind a low-pass filter of the driver: friction of a reversal that appears late."""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.facts.signals import Signals
import numpy as np

# Time constants that are tried, s, and then factors on the best one, twice.
_CONSTANTS = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
_FACTORS = ((0.7, 0.85, 1.0, 1.2, 1.4), (0.9, 1.0, 1.1))
# Angles over which friction may build up after a reversal, rad: those of gears, and of belts.
_ANGLES = (1e-4, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1)
# Number of columns of friction of each joint.
_FRICTION = 3
# Samples that are fitted, at most, and their minimum interval, s.
_MAX_SAMPLES, _MIN_INTERVAL = 5000, 0.02
# Ridge of unit columns, against rounding of those that are collinear over short travel.
_RIDGE = 1e-10


def filtered_effort(signals: Signals, options: FactOptions) -> tuple[Signals, Fact | None]:
    """
    Return the signals with the effort before a filter of the first order, and the fact.

    The gravity of the pose and the friction of the direction are fitted to the effort of each
    joint, both behind a filter. If the driver filters, the residual of the joints is much smaller
    than with friction that builds up after a reversal (geometric mean).
    """
    step = max(1, int(np.ceil(_MIN_INTERVAL / max(_interval(signals), 1e-9))))
    part = signals.keep(np.arange(len(signals)) % step == 0)
    part = part.keep(np.arange(len(part)) < _MAX_SAMPLES)
    if len(part) < options.min_samples or _interval(part) > min(_CONSTANTS[-1], 0.5):
        return signals, None
    columns, joints = _columns(part, options)
    if len(joints) < 2:
        return signals, None

    def cost(constant: float) -> float:
        return float(np.log(_residuals(part, columns, joints, constant)).sum())

    constant = min(_CONSTANTS, key=cost)
    if constant < 2 * _interval(signals):
        return signals, None
    for factors in _FACTORS:
        constant = _minimum({constant * factor: cost(constant * factor) for factor in factors})
    # Friction that builds up over an angle, another one of each joint, is late in another shape.
    way = np.abs(np.diff(part.q, axis=0))
    other = np.min([_rest(part, np.concatenate([
        columns[:, :, :-_FRICTION], _behind(columns[:, :, -_FRICTION:], way, angle)], axis=2),
        joints) for angle in _ANGLES] + [_rest(part, columns, joints)], axis=0)
    ratio = _residuals(part, columns, joints, constant) / other
    # The driver has one filter for all joints.
    if np.log(ratio).mean() >= np.log(options.better_lag):
        return signals, None
    clear = ratio < options.better_lag
    names = tuple(signals.names[n] for n, is_clear in zip(joints, clear) if is_clear)
    ratios = dict(zip(names, ratio[clear].tolist()))
    fact = Fact(
        Kind.LAG, names, f'effort follows the motion late on {", ".join(names)}, as behind a '
        f'low-pass filter of {constant:.2g} s', Action.CORRECTED, 'the filter is undone, for '
        'every joint; publish the effort without it if you can', f'--accept {Kind.LAG.value} '
        f'reads it as recorded', ratios)
    return replace(signals, tau=_undone(signals, constant)), fact


def _columns(signals: Signals, options: FactOptions) -> tuple[FloatArray, list[int]]:
    """Return columns (M, N, C) of each joint, and the joints that move."""
    moving = np.ptp(signals.q, axis=0) > options.min_travel
    q = signals.q[:, moving]
    poses = np.column_stack([np.ones(len(q)), np.sin(q), np.cos(q), np.sin(2 * q), np.cos(2 * q)])
    qd = np.nan_to_num(signals.qd)
    fastest = np.maximum(np.abs(qd).max(axis=0), 1e-12)
    friction = np.stack([np.tanh(qd / (0.05 * fastest)), np.sign(qd), qd], axis=2)
    joints = [n for n in np.flatnonzero(moving).tolist() if qd[:, n].any()
              and np.ptp(signals.tau[:, n]) > options.dead_torque]
    shared = np.broadcast_to(poses[:, None, :], (*qd.shape, poses.shape[1]))
    return np.concatenate([shared, friction], axis=2), joints


def _residuals(signals: Signals, columns: FloatArray, joints: list[int],
               constant: float) -> FloatArray:
    """Return the mean squared residual of each joint, columns behind a filter of `constant` s."""
    way = np.diff(signals.t)[:, None]
    return _rest(signals, _behind(columns, way, constant), joints)


def _behind(columns: FloatArray, way: FloatArray, constant: float) -> FloatArray:
    """Return columns (M, N, C) behind a filter over the way (M - 1, N) from sample to sample."""
    share = (1.0 - np.exp(-way / constant))[:, :, None]
    behind = columns.copy()
    for row, part in enumerate(share, 1):
        behind[row] = behind[row - 1] + part * (columns[row] - behind[row - 1])
    return behind


def _rest(signals: Signals, x: FloatArray, joints: list[int]) -> FloatArray:
    """Return the mean squared residual of the efforts of each joint, fitted by its columns."""
    rest = []
    for n in joints:
        own, tau = np.ascontiguousarray(x[:, n]), signals.tau[:, n]
        # Normal equations of unit columns: the residual is that of least squares up to the ridge.
        own = own / np.maximum(np.linalg.norm(own, axis=0), 1e-12)
        solution = np.linalg.solve(own.T @ own + _RIDGE * np.eye(own.shape[1]), own.T @ tau)
        rest.append(float(((tau - own @ solution) ** 2).mean()))
    return np.maximum(rest, 1e-18)


def _undone(signals: Signals, constant: float) -> FloatArray:
    """Return the efforts (M, N) before the filter."""
    share = 1.0 - np.exp(-np.diff(signals.t) / constant)
    tau = signals.tau.copy()
    tau[1:] = signals.tau[:-1] + np.diff(signals.tau, axis=0) / share[:, None]
    return np.asarray(tau)


def _minimum(costs: dict[float, float]) -> float:
    """Return the minimum of the parabola through the costs, over the logarithm of the key."""
    t = np.array(list(costs))
    a, b, _ = np.polyfit(np.log(t), list(costs.values()), 2)
    if a <= 0.0:
        return float(min(costs, key=costs.__getitem__))
    return float(np.exp(np.clip(-b / (2 * a), np.log(t.min()), np.log(t.max()))))


def _interval(signals: Signals) -> float:
    return float(np.median(np.diff(signals.t))) if len(signals) > 1 else 0.0
