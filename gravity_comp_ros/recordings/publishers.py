"""Several publishers of the same joints on one topic: messages not from the arm's driver."""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.joint_columns import Columns
import numpy as np

# Share of messages from which a group of messages may be a publisher of its own.
_MIN_SHARE = 0.01
# Changes from one group to the other per message of the smaller group: publishers alternate,
# whereas the arrays of one publisher change once, as its drives are enabled.
_MIN_CHANGES = 0.5
# Minimum median step between messages, rad, and maximum ratio of the step over two messages to
# it, of positions that alternate.
_MIN_STEP, _MAX_RETURN = 0.05, 0.2
# Minimum step to efforts of 0 as a share of the usual effort: a coarse sensor has smaller ones.
_MIN_FALL = 0.5


def second_publisher(columns: Columns, joints: Sequence[str], q: FloatArray,
                     tau: FloatArray) -> tuple[BoolArray, Fact | None]:
    """
    Return the mask (M,) of alternating messages without effort, and the fact about them.

    Messages without efforts, or with efforts of 0 only, are of a second publisher if they
    alternate with those of the driver, and have other positions or another order of joints, or
    if the efforts fall to 0 there. Those of the driver itself without efforts have no fact.

    :param q: positions (M, N) in any unit; NaN if missing.
    :param tau: efforts (M, N).
    """
    with_effort = np.nan_to_num(tau).any(axis=1)
    relevant: BoolArray = np.asarray(np.isfinite(q).any(axis=1))
    second: BoolArray = np.asarray(relevant & ~with_effort)
    few = min(int(second.sum()), int((relevant & with_effort).sum()))
    nothing = np.zeros_like(second)
    if few < _MIN_SHARE * relevant.sum() or few < 2:
        return nothing, None
    order = second[relevant]
    if np.count_nonzero(order[1:] != order[:-1]) < _MIN_CHANGES * few:
        return nothing, None
    names = columns.names_of(int(np.argmax(second)))
    if not _positions_differ(q[relevant], order):
        if np.isfinite(tau[second]).any():
            if not _efforts_fall(np.nan_to_num(tau[relevant]), order):
                return nothing, None
        elif names == columns.names_of(int(np.argmax(relevant & with_effort))):
            return second, None
    share = second.sum() / relevant.sum()
    listed = ', '.join(names[:6]) + (', …' if len(names) > 6 else '')
    return second, Fact(
        Kind.PUBLISHER, tuple(joint for joint in joints if joint in names),
        f'a second publisher sends {counted(int(second.sum()), "message")} without effort '
        f'({100 * share:.0f} %, in the order {listed})', Action.LEFT_OUT,
        'its messages are left out', '--accept second_publisher keeps them')


def _positions_differ(q: FloatArray, second: BoolArray) -> bool:
    """Return whether positions change where the publisher changes."""
    step = np.nanmax(np.abs(np.diff(q, axis=0)), axis=1)
    changes = second[1:] != second[:-1]
    return bool(np.nanmedian(step[changes]) > _MIN_STEP)


def _efforts_fall(tau: FloatArray, second: BoolArray) -> bool:
    """Return whether efforts change by their usual size where the publisher changes."""
    size = np.abs(tau[~second]).max(axis=1)
    step = np.abs(np.diff(tau, axis=0)).max(axis=1)[second[1:] != second[:-1]]
    return bool(np.median(step) > _MIN_FALL * np.median(size))


def positions_alternate(q: FloatArray) -> bool:
    """
    Return whether positions (M, N) in rad alternate between two values, message by message.

    This occurs if two robots publish the same joint names on one topic.
    """
    if len(q) < 20:
        return False
    for joint in q.T:
        step = np.median(np.abs(np.diff(joint)))
        if step > _MIN_STEP and np.median(np.abs(joint[2:] - joint[:-2])) < _MAX_RETURN * step:
            return True
    return False
