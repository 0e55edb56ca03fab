"""Conversion of the columns of a topic to samples; defects are dropped and counted, or refused."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.joint_columns import Columns
from gravity_comp_ros.recordings.read_notes import (
    degree_notes, gap_notes, mask_out_of_range, MAX_MAGNITUDE, zero_effort_note,
    zero_velocity_notes)
from gravity_comp_ros.recordings.read_options import ReadOptions, ReadReport, Recording
from gravity_comp_ros.recordings.several_arms import positions_alternate
from gravity_comp_ros.recordings.storage import fingerprint
from gravity_comp_ros.recordings.topic_choice import COMMON_DEFECT
import numpy as np
from numpy.typing import ArrayLike, NDArray

OTHER_JOINTS = 'other joints only'
MISSING = 'joint missing'
NOT_FINITE = 'position or effort missing or not finite'
VELOCITY = 'velocity missing or not finite'
TIME = 'time goes back or stands still'
ISOLATED = 'alone in a gap, no velocity'

# Share of stamps not later than an earlier one, above which the log time is used instead.
BAD_STAMPS = 0.1
# Minimum travel of a joint that counts as moving, rad.
MIN_TRAVEL = 1e-3


class Cleaning:
    """Steps from columns to samples; each step may drop messages and add notes."""

    def __init__(self, where: str, columns: Columns, joints: tuple[str, ...],
                 notes: list[str], degrees: bool) -> None:
        self.where, self.joints, self.notes = where, joints, notes
        self.dropped = Counter(columns.dropped)
        self.log_ns, self.stamp_ns = columns.log_ns, columns.stamp_ns
        self.degrees = degrees
        present = columns.presence(joints)
        self.q, self.qd, self.tau = columns.values(joints)
        beyond = mask_out_of_range(self.q, self.qd, self.tau)
        if beyond:
            self.notes.append(f'{counted(beyond, "value")} beyond {MAX_MAGNITUDE:g}: not a '
                              f'measurement, treated as missing')
        if degrees:
            self.q, self.qd = np.radians(self.q), np.radians(self.qd)
        self._keep(present.any(axis=1), OTHER_JOINTS)
        present = present[present.any(axis=1)]
        self._keep(present.all(axis=1), MISSING)

    def recording(self, path: Path, topic: str, n_messages: int,
                  options: ReadOptions) -> Recording:
        """
        Return the samples and the report.

        :raises BagError: if at least half of the messages have the same defect.
        """
        self._check_values()
        unmeasured = self._unmeasured(options)
        self._choose_clock()
        self._check_jumps()
        self._differentiate(unmeasured)
        time = (self.times - self.times[0]) / 1e9
        scale = options.scale(self.joints)
        self.tau *= list(scale.values())
        samples = JointSamples.single_run(
            self.joints, time, self._release('q'), self._release('qd'), self._release('tau'),
            path.name or path.resolve().name, int(self.times[0]) / 1e9)
        self.notes += gap_notes(time)
        largest = max(samples.q.max(initial=0.0), -samples.q.min(initial=0.0))
        self.notes += degree_notes(largest, self.degrees)
        report = read_report(path, topic, n_messages, time, self.dropped,
                             'differentiated' if unmeasured.any() else 'measured',
                             int(self.times[0]), scale, self.notes)
        return Recording(samples, report)

    def _release(self, name: str) -> NDArray[np.float64]:
        """Return an array, read-only, and drop the reference to it, to keep one copy in memory."""
        values: NDArray[np.float64] = self.__dict__.pop(name)
        if values.base is not None:
            values = values.copy()
        values.flags.writeable = False
        return values

    def _keep(self, keep: ArrayLike, reason: str) -> None:
        mask = np.asarray(keep, dtype=bool)
        lost = int(mask.size - np.count_nonzero(mask))
        if not lost:
            return
        self.dropped[reason] += lost
        for name in ('log_ns', 'stamp_ns', 'q', 'qd', 'tau'):
            setattr(self, name, getattr(self, name)[mask])
        if not self.log_ns.size:
            raise BagError(f'{self.where} has no usable message: {listed(self.dropped)}')

    def _check_values(self) -> None:
        """Refuse recordings without positions or torques; drop single invalid messages."""
        for what, values in (('position', self.q), ('effort', self.tau)):
            bad = ~np.isfinite(values)
            share = bad.mean(axis=0)
            if (share >= COMMON_DEFECT).all():
                raise BagError(f'{self.where}: {what} is missing, NaN or beyond '
                               f'{MAX_MAGNITUDE:g} in {int(bad.any(axis=1).sum())} of '
                               f'{len(values)} messages, for every joint; the driver must '
                               f'publish it')
            if (share >= COMMON_DEFECT).any():
                worst = int(np.argmax(share))
                good = ','.join(np.array(self.joints)[share < COMMON_DEFECT])
                raise BagError(
                    f'{self.where}: {what} of joint {self.joints[worst]} is missing, NaN or '
                    f'beyond {MAX_MAGNITUDE:g} in {int(bad[:, worst].sum())} of {len(values)} '
                    f'messages; leave it out with --joints {good}')
        self._keep(np.isfinite(self.q).all(axis=1) & np.isfinite(self.tau).all(axis=1),
                   NOT_FINITE)
        zero = ~self.tau.any(axis=0)
        if zero.all():
            raise BagError(f'{self.where}: effort is 0 throughout, for every joint; the driver '
                           f'does not measure it')
        for joint in np.array(self.joints)[zero]:
            self.notes.append(zero_effort_note(joint))

    def _check_jumps(self) -> None:
        if positions_alternate(self.q):
            raise BagError(f'{self.where}: positions alternate between two values from message to '
                           f'message, as if two robots published the same joint names on one '
                           f'topic; give each robot a namespace and record again')

    def _unmeasured(self, options: ReadOptions) -> BoolArray:
        """Return the mask (N,) of joints whose velocity is computed from the position."""
        if options.differentiate:
            return np.ones(len(self.joints), dtype=bool)
        unmeasured = (~np.isfinite(self.qd)).mean(axis=0) >= COMMON_DEFECT
        self._keep(np.isfinite(self.qd[:, ~unmeasured]).all(axis=1), VELOCITY)
        moves = np.ptp(self.q, axis=0) > MIN_TRAVEL
        self.notes += zero_velocity_notes(self.joints, moves, self.qd.any(axis=0) | unmeasured)
        return unmeasured

    def _choose_clock(self) -> None:
        """Choose stamp or log time, and drop messages that are not later than all before."""
        clock = self.stamp_ns
        backwards = np.count_nonzero(~_rising(clock))
        if backwards > BAD_STAMPS * clock.size:
            unset = 'are not set' if not clock.any() else 'do not increase'
            self.notes.append(f'header stamps {unset}: the time of recording is used')
            clock = self.log_ns
        rising = _rising(clock)
        self._keep(rising, TIME)
        self.times = clock[rising]

    def _differentiate(self, unmeasured: BoolArray) -> None:
        if not unmeasured.any():
            return
        time = (self.times - self.times[0]) / 1e9
        self.qd[:, unmeasured] = differentiate(time, self.q[:, unmeasured])
        finite = np.isfinite(self.qd).all(axis=1)
        self.times = self.times[finite]
        self._keep(finite, ISOLATED)
        names = ('every joint' if unmeasured.all()
                 else ', '.join(np.array(self.joints)[unmeasured]))
        self.notes.append(f'velocity of {names} is differentiated from the position (zero phase)')


def read_report(path: Path, topic: str, n_messages: int, t: FloatArray,
                dropped: Mapping[str, int], velocity: str, start_ns: int,
                scale: Mapping[str, float], notes: Sequence[str]) -> ReadReport:
    """
    Return the report on samples at times t (M,), in s since the first sample.

    :param scale: N·m per unit of effort, by joint.
    """
    steps = np.diff(t)
    return ReadReport(
        path, topic, n_messages, len(t), dict(dropped), velocity,
        float(1 / np.median(steps)) if steps.size else 0.0, float(t[-1]), start_ns,
        fingerprint(path), {joint: value for joint, value in scale.items() if value != 1.0},
        tuple(notes))


def _rising(values: NDArray[np.int64]) -> BoolArray:
    """Return the mask of values greater than all values before them."""
    before = np.maximum.accumulate(values)
    return np.append(np.ones(min(1, values.size), dtype=bool), values[1:] > before[:-1])


def listed(dropped: Mapping[str, int]) -> str:
    """Return the number of dropped messages by reason, as text."""
    return ', '.join(f'{count} {reason}' for reason, count in dropped.items())
