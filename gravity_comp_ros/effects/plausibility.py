"""Checks of coefficients against physics: the right sign, and no more torque than there is."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import Columns, Implausible, Motion, Setting
import numpy as np

# An effect that alone makes more than this many times the largest torque measured is two
# effects that cancel.
_TOO_MUCH = 1.5


def within_torque(columns: Columns) -> Implausible:
    """Return a check that an effect stays within the torque that was measured."""
    def check(values: FloatArray, setting: Setting, motion: Motion, joint: int) -> str | None:
        made = np.abs(columns(motion, joint, setting) @ np.asarray(values))
        measured = np.abs(motion.samples.tau)
        if made.ndim == 1:
            measured = measured[:, joint]
        peak, limit = float(made.max(initial=0.0)), float(measured.max(initial=0.0))
        if peak > _TOO_MUCH * limit:
            return (f'it would make up to {peak:.3g} N·m where at most {limit:.3g} N·m were '
                    f'measured')
        return None
    return check


def not_negative(columns: Columns, because: str) -> Implausible:
    """Return a check that no coefficient is negative, and that the torque exists."""
    size = within_torque(columns)

    def check(values: FloatArray, setting: Setting, motion: Motion, joint: int) -> str | None:
        if np.min(values) < 0.0:
            return f'the coefficient is negative ({np.min(values):.3g}): {because}'
        return size(values, setting, motion, joint)
    return check


def smaller_than(columns: Columns, limit: float, unit: str, because: str) -> Implausible:
    """Return a check that no coefficient exceeds `limit` in size, and that the torque exists."""
    size = within_torque(columns)

    def check(values: FloatArray, setting: Setting, motion: Motion, joint: int) -> str | None:
        largest = float(np.abs(values).max())
        if largest > limit:
            return f'{largest:.3g} {unit} is too much: {because}'.replace('  ', ' ')
        return size(values, setting, motion, joint)
    return check


def at_least(limit: float, because: str) -> Implausible:
    """Return a check that the largest coefficient is no smaller than `limit` in size."""
    def check(values: FloatArray, setting: Setting, motion: Motion, joint: int) -> str | None:
        largest = float(np.abs(values).max())
        return None if largest >= limit else f'{largest:.2g} is too little: {because}'
    return check


def all_of(*checks: Implausible) -> Implausible:
    """Return a check that gives the first objection of several."""
    def check(values: FloatArray, setting: Setting, motion: Motion, joint: int) -> str | None:
        reasons = (one(values, setting, motion, joint) for one in checks)
        return next((reason for reason in reasons if reason), None)
    return check
