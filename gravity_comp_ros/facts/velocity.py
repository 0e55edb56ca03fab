"""Velocities that are missing, 0, or contradict the slope of the position."""

from __future__ import annotations

from gravity_comp_ros.data.differentiation import is_inconsistent, MAX_INTERVAL, slope_ratios
from gravity_comp_ros.data.samples import BoolArray
from gravity_comp_ros.facts.fact import Action, Fact, Kind, listed
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.facts.signals import Signals
import numpy as np

_KEEP = '--accept velocity keeps it'


def velocity_facts(signals: Signals, missing: BoolArray,
                   options: FactOptions) -> tuple[BoolArray, list[Fact]]:
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
        if not (zero | missing | ~moves).all() or _is_stream(signals, zero, options):
            replaced |= zero
            facts.append(Fact(Kind.VELOCITY, names, evidence, Action.CORRECTED,
                              'the driver does not measure it; it is differentiated from the '
                              'position', _KEEP))
        else:
            facts.append(Fact(Kind.VELOCITY, names, evidence, Action.NOTED,
                              'read as a series of static poses',
                              '--differentiate computes it from the position'))
    if len(signals) >= options.min_samples:
        ratio, likeness = slope_ratios(signals.t, signals.q, signals.qd)
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


def _is_stream(signals: Signals, joints: BoolArray, options: FactOptions) -> bool:
    """Return whether positions are those of a motion, at the rate of a driver."""
    if len(signals) < 20 or signals.interval > MAX_INTERVAL:
        return False
    q = signals.q[:, joints]
    return bool((np.diff(q, axis=0).var(axis=0) < options.smooth * q.var(axis=0)).all())
