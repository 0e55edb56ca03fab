"""What a motion shows of a joint, and the words for what it does not show."""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# A joint that travels less than this, in rad, stands for our purposes.
STILL = 0.01
# Speeds beyond this many sign widths have a sure direction.
_SURE = 2.0
_LEAST_SHARE = 0.01
# Another joint that turns less than this, in rad, leaves the posture as it is.
_SAME_POSTURE = 0.1
# Parts of a joint's travel at either end in which the other joints are looked at.
_END = 0.3
_LEAST_SAMPLES = 5
_LEAST_REVERSALS = 4


def travel(motion: Motion, joint: int) -> float:
    """Return the range of a joint's angle, rad."""
    return float(np.ptp(motion.samples.q[:, joint])) if motion.samples.n_samples else 0.0


def moving(motion: Motion, joint: int) -> BoolArray:
    """Return where a joint surely moves, (M,)."""
    fast = np.abs(motion.samples.qd[:, joint]) > _SURE * motion.sign_width[joint]
    return np.asarray(fast)


def top_speed(motion: Motion, joint: int) -> float:
    """Return the speed that a joint exceeds in 2 % of its moving samples, rad/s; 0 if none."""
    speeds = np.abs(motion.samples.qd[moving(motion, joint), joint])
    return float(np.quantile(speeds, 0.98)) if speeds.size else 0.0


def reversals(motion: Motion, joint: int) -> int:
    """Return how often a joint surely turns back within a run."""
    sure = moving(motion, joint)
    up, runs = motion.samples.qd[sure, joint] > 0, motion.samples.runs[sure]
    return int(np.count_nonzero((np.diff(up.astype(int)) != 0) & (np.diff(runs) == 0)))


def insufficient_reversals(motion: Motion, joint: int) -> str | None:
    """Return why friction near reversals has no visible course, if a joint hardly turns back."""
    turns = reversals(motion, joint)
    if turns < _LEAST_REVERSALS:
        return (f'the joint turns back {turns} times; friction that builds up after a reversal '
                f'needs at least {_LEAST_REVERSALS}')
    return None


def stands(motion: Motion) -> str | None:
    """Return why speeds tell nothing, if every speed is 0."""
    if motion.samples.qd.any():
        return None
    return 'every speed is 0, as in poses at rest, and friction shows only in motion'


def insufficient_motion(motion: Motion, joint: int) -> str | None:
    """Return why a joint's motion shows nothing, if it stands throughout."""
    if stands(motion):
        return stands(motion)
    if travel(motion, joint) < STILL or not _enough(moving(motion, joint)):
        return (f'the joint hardly moves: {travel(motion, joint):.2g} rad of travel, never '
                f'clearly faster than {_SURE * motion.sign_width[joint]:.2g} rad/s')
    return None


def lacks_both_ways(motion: Motion, joint: int) -> str | None:
    """Return why friction cannot be seen, if a joint stands or moves one way only."""
    if insufficient_motion(motion, joint):
        return insufficient_motion(motion, joint)
    sure, qd = moving(motion, joint), motion.samples.qd[:, joint]
    if not (_enough(sure & (qd > 0)) and _enough(sure & (qd < 0))):
        return ('the joint moves one way only, so that what turns with its direction cannot be '
                'told from an offset')
    return None


def insufficient_speeds(motion: Motion, joint: int) -> str | None:
    """Return why speed has no visible influence, if a joint moves at one speed only."""
    if lacks_both_ways(motion, joint):
        return lacks_both_ways(motion, joint)
    speeds = np.abs(motion.samples.qd[moving(motion, joint), joint])
    low, high = np.quantile(speeds, (0.1, 0.9))
    if high < 1.3 * low:
        return (f'the joint moves at nearly one speed ({low:.2g} to {high:.2g} rad/s), so that '
                f'what grows with speed cannot be told from what is constant')
    return None


def lacks_holds(motion: Motion, joint: int) -> str | None:
    """Return why standing cannot be compared with moving, if a joint is never free."""
    if insufficient_motion(motion, joint):
        return insufficient_motion(motion, joint)
    free = np.abs(motion.direction(joint)) < 0.5
    if free.mean() < 2 * _LEAST_SHARE or free.sum() < 2 * _LEAST_SAMPLES:
        return ('the joint never stands for long, or its friction holds on when it does, so that '
                'this friction is the same as an offset')
    return None


def insufficient_load(motion: Motion, joint: int) -> str | None:
    """Return why the load has no visible influence, if it hardly varies."""
    load = np.abs(motion.gravity[:, joint])
    middle, spread = float(load.mean()), float(load.std())
    if spread < max(0.1 * middle, 0.02):
        return (f'the load hardly varies ({middle:.3g} N·m with a spread of {spread:.2g} N·m)')
    return None


def insufficient_postures(motion: Motion, joint: int) -> str | None:
    """
    Return why a torque of the angle looks like gravity, if the others stand while a joint moves.

    The gravity of a joint changes with the posture of the others; what pulls at it does not.
    """
    q = motion.samples.q
    if q.shape[1] == 1 or not len(q):
        return None
    others = np.delete(q, joint, axis=1)
    low, high = np.quantile(q[:, joint], (_END / 2, 1.0 - _END / 2))
    for end in (q[:, joint] <= low, q[:, joint] >= high):
        if np.ptp(others[end], axis=0).max() < _SAME_POSTURE:
            return ('the other joints stand still while it moves, so that a torque of its angle '
                    'looks like gravity')
    return None


def _enough(mask: BoolArray) -> bool:
    return bool(mask.mean() >= _LEAST_SHARE and mask.sum() >= _LEAST_SAMPLES)
