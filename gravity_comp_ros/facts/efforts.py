"""Efforts that are no torque: dead, of another unit, clipped, frozen, or of a disabled drive."""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, evenly_picked, FloatArray
from gravity_comp_ros.facts.fact import Action, Fact, Kind, listed, rows_left_out
from gravity_comp_ros.facts.options import FACTS
from gravity_comp_ros.facts.signals import Signals, spans, stretches
import numpy as np

# Share of the limit by which equal values may differ.
_ROUNDING = 1e-9


def dead(signals: Signals) -> list[Fact]:
    """Return the facts on joints whose effort is 0, denormal or constant throughout."""
    largest = np.abs(signals.tau).max(axis=0)
    enough = len(signals) >= FACTS.min_samples
    is_dead = largest < (FACTS.dead_torque if enough else 1e-300)
    is_constant = ~is_dead & (np.ptp(signals.tau, axis=0) < 1e-9)
    facts = []
    if is_dead.all():
        size = f' (at most {largest.max():.2g})' if largest.any() else ''
        facts.append(Fact(
            Kind.DEAD_EFFORT, signals.names, f'effort is 0 throughout, for every joint{size}',
            Action.REFUSED, 'the driver does not measure it', values=_by_joint(signals, largest)))
    elif is_dead.any():
        names, alive = signals.named(is_dead), signals.named(~is_dead)
        facts.append(Fact(
            Kind.DEAD_EFFORT, names, f'effort of {", ".join(names)} is always 0', Action.NOTED,
            'no torque acts there, or the driver does not measure it',
            f'--joints {",".join(alive)} leaves it out', {
                name: value for name, value in _by_joint(signals, largest).items()
                if name in names}))
    if is_constant.any():
        names = signals.named(is_constant)
        facts.append(Fact(Kind.CONSTANT_EFFORT, names, f'effort never changes: {", ".join(names)}',
                          Action.NOTED))
    return facts


def unit(signals: Signals, raw: FloatArray, scaled: BoolArray) -> list[Fact]:
    """
    Return the facts on the unit of effort.

    :param raw: efforts (M, N) before scaling; whole numbers are raw counts.
    :param scaled: mask (N,) of joints whose unit was given.
    """
    largest = np.quantile(np.abs(signals.tau), 0.98, axis=0)
    option = ('--effort-unit UNIT, --effort-scale JOINT=N·m per unit, or --accept effort_unit if '
              'it is right')
    facts = []
    if len(signals) >= FACTS.min_samples:
        if FACTS.dead_torque < np.abs(signals.tau).max() < FACTS.min_torque:
            facts.append(Fact(
                Kind.EFFORT_UNIT, signals.names, f'no effort reaches {FACTS.min_torque:g} N·m '
                f'(at most {np.abs(signals.tau).max():.2g})', Action.REFUSED,
                'an arm that holds its own links needs more, so that the effort is not a torque '
                'in N·m: an error of position or a share of a rated torque has this size',
                option, _by_joint(signals, largest)))
        too_large = largest > FACTS.max_torque
        if too_large.any():
            names = signals.named(too_large)
            facts.append(Fact(
                Kind.EFFORT_UNIT, names, f'effort reaches {largest.max():.3g} on '
                f'{", ".join(names)}', Action.REFUSED, 'no arm has such torques in N·m',
                option, _by_joint(signals, largest)))
    counts = _whole(raw) & ~scaled
    if counts.any():
        names = signals.named(counts)
        facts.append(Fact(
            Kind.EFFORT_UNIT, names, f'effort has whole numbers only on '
            f'{listed(names, len(signals.names))}', Action.NOTED,
            'counts, mA or per mille of a rated torque rather than N·m; a model predicts them in '
            'this unit', '--effort-scale JOINT=VALUE gives the N·m per unit; for per mille, '
            '--effort-unit permille --rated-torque JOINT=N·m',
            _by_joint(signals, largest)))
    return facts


def _whole(raw: FloatArray) -> BoolArray:
    """Return the mask (N,) of joints with large whole numbers, of several values."""
    part = raw[evenly_picked(len(raw), FACTS.max_samples)]
    whole = (part == np.rint(part)).all(axis=0) & (np.ptp(part, axis=0) > 2)
    return np.asarray(whole & (np.abs(part[:, whole]).max(initial=0.0) >= FACTS.min_count))


def disabled(signals: Signals) -> tuple[BoolArray, Fact | None]:
    """Return the mask (M,) of samples in which every effort is exactly 0, and the fact."""
    rows: BoolArray = np.asarray(~signals.tau.any(axis=1))
    longest = max((signals.t[part.stop - 1] - signals.t[part.start] for part in stretches(rows)),
                  default=0.0)
    if rows.all() or longest < FACTS.min_time:
        return np.zeros(len(rows), dtype=bool), None
    return rows, rows_left_out(
        Kind.DISABLED, (), f'effort of every joint is exactly 0 from {spans(signals.t, rows)}',
        rows, reason='the drives are disabled; ')


def frozen(signals: Signals) -> tuple[BoolArray, Fact | None]:
    """Return the mask (M,) of samples in which a value stays the same in motion, and the fact."""
    rows, times = np.zeros(len(signals), dtype=bool), {}
    travelled = np.zeros_like(signals.q)
    travelled[1:] = np.cumsum(np.abs(np.diff(signals.q, axis=0)), axis=0)
    integral = np.zeros_like(signals.qd)
    speed = np.abs(np.nan_to_num(signals.qd[1:] + signals.qd[:-1]))
    dt = np.diff(signals.t)[:, None]
    integral[1:] = np.cumsum(0.5 * speed * dt, axis=0)
    # Without velocities, the jump at the end of a stretch tells that the joint moved.
    unknown = ~np.isfinite(signals.qd).any(axis=0)
    step = np.abs(np.diff(signals.q[:, unknown], axis=0))
    jump = np.where(step > FACTS.max_acceleration * dt ** 2, step, 0.0)
    integral[:-1, unknown] = np.cumsum(jump, axis=0)
    for n, name in enumerate(signals.names):
        of_effort = _frozen_rows(signals.t, signals.tau[:, n], travelled[:, n])
        # Friction alone stays at an extreme for as long as the joint moves in one direction.
        of_effort &= _inside(signals.tau[:, n])
        for part in (of_effort, _frozen_rows(signals.t, signals.q[:, n], integral[:, n])):
            if part.any():
                rows |= part
                times[name] = float(part.sum())
    if not times:
        return rows, None
    return rows, rows_left_out(
        Kind.FROZEN, tuple(times), f'a value of {", ".join(times)} stays exactly the same during '
        f'motion, from {spans(signals.t, rows)}', rows, times)


def _frozen_rows(t: FloatArray, values: FloatArray, travel: FloatArray) -> BoolArray:
    same = (np.diff(values) == 0) & (np.ptp(values) > FACTS.dead_torque)
    rows = np.zeros(len(values), dtype=bool)
    for part in stretches(same):
        first, last = part.start, part.stop
        if (last - first >= FACTS.equal_values and t[last] - t[first] >= FACTS.min_time
                and travel[last] - travel[first] >= FACTS.min_motion):
            rows[first:last + 1] = True
    others = same[~rows[1:]]
    # A coarse signal repeats its values elsewhere too.
    if not others.size or others.mean() > FACTS.max_outliers:
        rows[:] = False
    return rows


def _inside(values: FloatArray) -> BoolArray:
    """Return the mask (M,) of values that are not an extreme."""
    low, high = values.min(), values.max()
    edge = _ROUNDING * max(abs(low), abs(high))
    return np.asarray((values > low + edge) & (values < high - edge))


def saturated(signals: Signals) -> tuple[BoolArray, Fact | None]:
    """Return the mask (M,) of samples with an effort clipped at a limit, and the fact."""
    rows, limits, counts = np.zeros(len(signals), dtype=bool), {}, {}
    for n, name in enumerate(signals.names):
        tau, q = signals.tau[:, n], signals.q[:, n]
        clipped = np.zeros_like(rows)
        for sign in (1.0, -1.0):
            at_limit = _at_limit(sign * tau, q, signals.qd[:, n])
            if at_limit.any():
                clipped |= at_limit
                limits[name] = float(tau[at_limit][0])
        if clipped.any():
            rows |= clipped
            counts[name] = float(clipped.mean())
    if not counts:
        return rows, None
    parts = [f'{name} at {limits[name]:.4g} N·m in {100 * share:.0f} % of the samples'
             for name, share in counts.items()]
    return rows, rows_left_out(Kind.SATURATED, tuple(counts),
                               f'effort is clipped on {", ".join(parts)}', rows, counts)


def _at_limit(tau: FloatArray, q: FloatArray, qd: FloatArray) -> BoolArray:
    """Return the mask (M,) of samples at the upper limit of tau (M,), if it is clipped."""
    limit = tau.max()
    at_limit = np.asarray(tau >= limit - _ROUNDING * abs(limit))
    none = np.zeros_like(at_limit)
    if limit <= 0 or at_limit.mean() < FACTS.rare:
        return none
    near = tau[(tau > 0.8 * limit) & ~at_limit]
    levels = np.unique(near)
    if len(near) < FACTS.rare * len(tau) or len(levels) < 5:
        return none
    per_level = len(near) / len(levels)
    is_symmetric = abs(tau.min() + limit) <= 1e-6 * limit
    if is_symmetric and any(at_limit[way].mean() > 0.5 and not at_limit[~way].any()
                            for way in (qd > 0, qd < 0) if way.any()):
        return none  # friction alone: the same effort whenever the joint moves this way
    moves = np.ptp(q[at_limit]) > FACTS.min_travel
    in_stretches = np.count_nonzero(at_limit[1:] & at_limit[:-1]) > 0.5 * at_limit.sum()
    if at_limit.sum() < FACTS.equal_values * per_level or not (moves and in_stretches):
        return none
    return at_limit


def _by_joint(signals: Signals, values: FloatArray) -> dict[str, float]:
    return dict(zip(signals.names, map(float, values)))
