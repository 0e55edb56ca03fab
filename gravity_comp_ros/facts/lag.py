"""Velocities that contradict the position, and efforts behind a low-pass filter of the driver."""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.differentiation import is_inconsistent, MAX_INTERVAL, slope_ratios
from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.facts.fact import Action, Fact, Kind, listed
from gravity_comp_ros.facts.friction import friction_columns
from gravity_comp_ros.facts.options import FACTS
from gravity_comp_ros.facts.signals import Signals
import numpy as np

# Ridge of unit columns, against rounding of those that are collinear over short travel.
_RIDGE = 1e-10
_KEEP = '--accept velocity keeps it'


def filtered_effort(signals: Signals) -> tuple[Signals, Fact | None]:
    """
    Return the signals with the effort before a filter of the first order, and the fact.

    The gravity of the pose and the friction of the direction are fitted to the effort of each
    joint, both behind a filter. If the driver filters, the residual of the joints is much smaller
    than with friction that builds up after a reversal (geometric mean).
    """
    # Ten samples in the shortest time constant resolve it.
    step = max(1, int(np.ceil(0.1 * FACTS.lags[0] / max(signals.interval, 1e-9))))
    part = signals.keep(np.arange(len(signals)) % step == 0)
    part = part.keep(np.arange(len(part)) < FACTS.max_samples)
    if len(part) < FACTS.min_samples or part.interval > FACTS.lags[1]:
        return signals, None
    poses, friction, joints = _columns(part)
    if len(joints) < 2:
        return signals, None
    tau, time = part.tau[:, joints], np.diff(part.t)[:, None]

    def residuals(constant: float) -> FloatArray:
        return _rest(tau, _behind(poses, time, constant),
                     _behind(friction, time[:, None], constant))

    def cost(constant: float) -> float:
        return float(np.log(residuals(constant)).sum())

    constant, factor = min(FACTS.lags, key=cost), 2.0
    for _ in range(3):
        constant = _minimum({constant * x: cost(constant * x) for x in (1 / factor, 1.0, factor)})
        factor = float(np.sqrt(factor))
    # A longer one is the residual of slow motion.
    if not 2 * signals.interval <= constant <= FACTS.lags[-1]:
        return signals, None
    # Friction that builds up over an angle, another one of each joint, is late in another shape.
    way = np.abs(np.diff(part.q[:, joints], axis=0))[:, None]
    other = np.min([_rest(tau, poses, friction), *(
        _rest(tau, poses, _behind(friction, way, angle)) for angle in FACTS.angles)], axis=0)
    ratio = residuals(constant) / other
    # The driver has one filter for all joints.
    if np.log(ratio).mean() >= np.log(FACTS.better):
        return signals, None
    clear = ratio < FACTS.better
    names = tuple(signals.names[n] for n, is_clear in zip(joints, clear) if is_clear)
    ratios = dict(zip(names, ratio[clear].tolist()))
    fact = Fact(
        Kind.LAG, names, f'effort follows the motion late on {", ".join(names)}, as behind a '
        f'low-pass filter of {constant:.2g} s', Action.CORRECTED, 'the filter is undone, for '
        'every joint; publish the effort without it if you can', f'--accept {Kind.LAG} '
        f'reads it as recorded', ratios)
    return replace(signals, tau=_undone(signals, constant)), fact


def _columns(signals: Signals) -> tuple[FloatArray, FloatArray, list[int]]:
    """Return columns (M, P) of poses and (M, 3, J) of the friction of J joints, and these."""
    moving = np.ptp(signals.q, axis=0) > FACTS.min_travel
    q, qd = signals.q[:, moving], np.nan_to_num(signals.qd)
    poses = np.column_stack([np.ones(len(q)), np.sin(q), np.cos(q), np.sin(2 * q), np.cos(2 * q)])
    joints = [n for n in np.flatnonzero(moving).tolist() if qd[:, n].any()
              and np.ptp(signals.tau[:, n]) > FACTS.dead_torque]
    return poses, friction_columns(qd[:, joints]), joints


def _behind(columns: FloatArray, way: FloatArray, constant: float) -> FloatArray:
    """Return columns (M, ...) behind a filter over the way (M - 1, ...) from sample to sample."""
    # Parts of the recording are filtered side by side, then each from the end of the one before.
    count = int(np.ceil(np.sqrt(len(columns))))
    keep = np.ones((count ** 2, *way.shape[1:]))
    keep[1:len(columns)] = np.exp(-way / constant)
    behind = np.zeros((count ** 2, *columns.shape[1:]))
    behind[0], behind[1:len(columns)] = columns[0], (1.0 - keep[1:len(columns)]) * columns[1:]
    keep, behind = (x.reshape(count, count, *x.shape[1:]) for x in (keep, behind))
    for step in range(1, count):
        behind[:, step] += keep[:, step] * behind[:, step - 1]
    decay = np.cumprod(keep, axis=1)
    for number in range(1, count):
        behind[number] += decay[number] * behind[number - 1, -1]
    return np.asarray(behind.reshape(count ** 2, *columns.shape[1:])[:len(columns)])


def _rest(tau: FloatArray, poses: FloatArray, friction: FloatArray) -> FloatArray:
    """Return the mean squared residual (J,) of efforts (M, J) fitted by the columns of each."""
    # Normal equations of unit columns: the residual is that of least squares up to the ridge.
    poses, friction = (x / np.maximum(np.linalg.norm(x, axis=0), 1e-12) for x in (poses, friction))
    own, count = np.ascontiguousarray(friction.T), poses.shape[1]
    cross, square = own @ poses, np.broadcast_to(poses.T @ poses, (len(own), count, count))
    gram = np.block([[square, cross.swapaxes(1, 2)], [cross, own @ own.swapaxes(1, 2)]])
    right = np.concatenate([(poses.T @ tau).T[:, :, None], own @ tau.T[:, :, None]], axis=1)
    solution = np.linalg.solve(gram + _RIDGE * np.eye(gram.shape[1]), right)
    rest = tau - poses @ solution[:, :count, 0].T - (solution.swapaxes(1, 2)[
        :, :, count:] @ own)[:, 0].T
    return np.asarray(np.maximum((rest ** 2).mean(axis=0), 1e-18))


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


def velocity_facts(signals: Signals, missing: BoolArray) -> tuple[BoolArray, list[Fact]]:
    """
    Return the mask (N,) of joints whose velocity must be differentiated, and the facts.

    :param missing: mask (N,) of joints without velocities.
    """
    facts: list[Fact] = []
    total = len(signals.names)
    if missing.any():
        names = signals.named(missing)
        facts.append(Fact(
            Kind.VELOCITY, names, f'velocity of {listed(names, total)} is not recorded',
            Action.CORRECTED, 'it is differentiated from the position (zero phase)'))
    moves = np.ptp(signals.q, axis=0) > 1e-3
    zero = moves & ~missing & ~signals.qd.any(axis=0)
    replaced = missing.copy()
    if zero.any():
        names = signals.named(zero)
        evidence = f'velocity of {listed(names, total)} is 0 throughout although the joint moves'
        if not (zero | missing | ~moves).all() or _is_stream(signals, zero):
            replaced |= zero
            facts.append(Fact(Kind.VELOCITY, names, evidence, Action.CORRECTED,
                              'the driver does not measure it; it is differentiated from the '
                              'position', _KEEP))
        else:
            facts.append(Fact(Kind.VELOCITY, names, evidence, Action.NOTED,
                              'read as a series of static poses',
                              '--differentiate computes it from the position'))
    if len(signals) >= FACTS.min_samples:
        ratio, likeness = slope_ratios(signals.t, signals.q, signals.qd, signals.rows)
        wrong = is_inconsistent(ratio, likeness) & ~missing & ~zero
        if wrong.any():
            names = signals.named(wrong)
            values = dict(zip(names, ratio[wrong].tolist()))
            by_size: dict[str, list[str]] = {}
            for name, value in values.items():
                by_size.setdefault(f'{value:.0f}' if abs(value) >= 10 else f'{value:.2g}',
                                   []).append(name)
            parts = ', '.join(f'{listed(joints, total)} ({size} times the slope)'
                              for size, joints in by_size.items())
            replaced |= wrong
            facts.append(Fact(
                Kind.VELOCITY, names, f'velocity contradicts position on {parts}',
                Action.CORRECTED, 'the slope of the position is used instead; check the unit of '
                'velocity in the driver', _KEEP, values))
    return replaced, facts


def _is_stream(signals: Signals, joints: BoolArray) -> bool:
    """Return whether positions are those of a motion, at the rate of a driver."""
    if len(signals) < 20 or signals.interval > MAX_INTERVAL:
        return False
    q = signals.q[:, joints]
    return bool((np.diff(q, axis=0).var(axis=0) < FACTS.smooth * q.var(axis=0)).all())
