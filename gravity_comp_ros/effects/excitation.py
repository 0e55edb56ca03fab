"""Excitation of a joint by a motion, and the reasons why it is insufficient for an effect."""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.printable import counted
import numpy as np

# Maximum travel, in rad, of a joint that counts as at rest.
STILL = 0.01
# Minimum share and number of samples of a condition.
_MIN_SHARE = 0.01
_MIN_SAMPLES = 5
_MIN_REVERSALS = 4
# Minimum standard deviation of a load relative to its mean; the evidence judges more variation.
_MIN_VARIATION = 0.02


def travel(motion: Motion, joint: int) -> float:
    """Return the range of a joint's angle in rad."""
    return float(np.ptp(motion.samples.q[:, joint])) if motion.samples.n_samples else 0.0


def moving(motion: Motion, joint: int) -> BoolArray:
    """Return whether a joint moves with a certain direction, (M,)."""
    fast = np.abs(motion.samples.qd[:, joint]) > motion.min_speed(joint)
    return np.asarray(fast)


def top_speed(motion: Motion, joint: int) -> float:
    """Return the 98 % quantile of a joint's speed while moving, in rad/s; 0 at rest."""
    speeds = np.abs(motion.samples.qd[moving(motion, joint), joint])
    return float(np.quantile(speeds, 0.98)) if speeds.size else 0.0


def reversals(motion: Motion, joint: int) -> int:
    """Return the number of reversals of a joint within runs."""
    certain = moving(motion, joint)
    up, runs = motion.samples.qd[certain, joint] > 0, motion.samples.runs[certain]
    return int(np.count_nonzero((np.diff(up.astype(int)) != 0) & (np.diff(runs) == 0)))


def insufficient_reversals(motion: Motion, joint: int) -> str | None:
    """Return the reason if a joint has too few reversals for presliding friction."""
    count = reversals(motion, joint)
    if count < _MIN_REVERSALS:
        return (f'the joint has {counted(count, "reversal")}; friction that builds up after a '
                f'reversal requires at least {_MIN_REVERSALS}')
    return None


def insufficient_motion(motion: Motion, joint: int) -> str | None:
    """Return the reason if a joint is at rest throughout."""
    if not motion.samples.qd.any():
        return 'every speed is 0, as in poses at rest, and friction requires motion'
    if travel(motion, joint) < STILL or not _enough(moving(motion, joint)):
        return (f'the joint hardly moves: {travel(motion, joint):.2g} rad of travel, no speed '
                f'clearly above {motion.min_speed(joint):.2g} rad/s')
    return None


def insufficient_directions(motion: Motion, joint: int) -> str | None:
    """Return the reason if a joint is at rest or moves in one direction only."""
    if reason := insufficient_motion(motion, joint):
        return reason
    certain, qd = moving(motion, joint), motion.samples.qd[:, joint]
    if not (_enough(certain & (qd > 0)) and _enough(certain & (qd < 0))):
        return ('the joint moves in one direction only, so that friction cannot be distinguished '
                'from an offset')
    return None


def insufficient_speeds(motion: Motion, joint: int) -> str | None:
    """Return the reason if a joint moves at one speed only."""
    if reason := insufficient_directions(motion, joint):
        return reason
    speeds = np.abs(motion.samples.qd[moving(motion, joint), joint])
    low, high = np.quantile(speeds, (0.1, 0.9))
    if high < 1.3 * low:
        return (f'the joint moves at nearly one speed ({low:.2g} to {high:.2g} rad/s), so that '
                f'friction that depends on speed cannot be distinguished from constant friction')
    return None


def insufficient_load(load: FloatArray) -> str | None:
    """Return the reason if a load (M,) in N·m hardly varies."""
    mean, std = float(load.mean()), float(load.std())
    if std <= _MIN_VARIATION * abs(mean):
        return (f'the load hardly varies (mean {mean:.3g} N·m, standard deviation {std:.2g} N·m)')
    return None


def _enough(mask: BoolArray) -> bool:
    return bool(mask.mean() >= _MIN_SHARE and mask.sum() >= _MIN_SAMPLES)
