"""From the columns of a topic to samples: what cannot be used is dropped, counted or refused."""

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
    degree_notes, drop_impossible, gap_notes, IMPOSSIBLE, zero_effort_note, zero_velocity_notes)
from gravity_comp_ros.recordings.read_options import ReadOptions, ReadReport, Recording
from gravity_comp_ros.recordings.several_arms import jumps_to_and_fro
from gravity_comp_ros.recordings.storage import fingerprint
from gravity_comp_ros.recordings.topic_choice import RULE
import numpy as np
from numpy.typing import ArrayLike, NDArray

OTHER_JOINTS = 'other joints only'
MISSING = 'joint missing'
NOT_FINITE = 'position or effort missing or not finite'
VELOCITY = 'velocity missing or not finite'
TIME = 'time goes back or stands still'
LONELY = 'alone in a gap, no velocity'

# Stamps that go back more often than this are no clock.
BAD_STAMPS = 0.1
# A joint that travels further than this moves, rad.
MOVES = 1e-3


class Cleaning:
    """The steps from columns to samples; every step may drop messages and leave notes."""

    def __init__(self, where: str, columns: Columns, joints: tuple[str, ...],
                 notes: list[str], degrees: bool) -> None:
        self.where, self.joints, self.notes = where, joints, notes
        self.dropped = Counter(columns.dropped)
        self.log_ns, self.stamp_ns = columns.log_ns, columns.stamp_ns
        self.degrees = degrees
        present = columns.presence(joints)
        self.q, self.qd, self.tau = columns.values(joints)
        beyond = drop_impossible(self.q, self.qd, self.tau)
        if beyond:
            self.notes.append(f'{counted(beyond, "value")} beyond {IMPOSSIBLE:g}: no measurement '
                              f'of an arm, so taken as missing')
        if degrees:
            self.q, self.qd = np.radians(self.q), np.radians(self.qd)
        self._keep(present.any(axis=1), OTHER_JOINTS)
        present = present[present.any(axis=1)]
        self._keep(present.all(axis=1), MISSING)

    def recording(self, path: Path, topic: str, n_messages: int,
                  options: ReadOptions) -> Recording:
        """
        Return what can be used of the columns.

        :raises BagError: if at least half of the messages share one defect.
        """
        self._check_values()
        unmeasured = self._unmeasured(options)
        clock = self._clock()
        self._check_jumps()
        self._differentiate(clock, unmeasured)
        time = (self.times - self.times[0]) / 1e9
        scale = options.scale(self.joints)
        self.tau *= list(scale.values())
        samples = JointSamples.single_run(
            self.joints, time, self._given('q'), self._given('qd'), self._given('tau'),
            path.name or path.resolve().name, int(self.times[0]) / 1e9)
        self.notes += gap_notes(time)
        furthest = max(samples.q.max(initial=0.0), -samples.q.min(initial=0.0))
        self.notes += degree_notes(furthest, self.degrees)
        report = read_report(path, topic, n_messages, time, self.dropped,
                             'differentiated' if unmeasured.any() else 'measured',
                             int(self.times[0]), scale, self.notes)
        return Recording(samples, report)

    def _given(self, name: str) -> NDArray[np.float64]:
        """Give an array away, read-only: long recordings are held once."""
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
        """Refuse recordings whose torques or positions are not there; drop single accidents."""
        for what, values in (('position', self.q), ('effort', self.tau)):
            bad = ~np.isfinite(values)
            share = bad.mean(axis=0)
            if (share >= RULE).all():
                raise BagError(f'{self.where}: {what} is missing, NaN or beyond {IMPOSSIBLE:g} in '
                               f'{int(bad.any(axis=1).sum())} of {len(values)} messages, for '
                               f'every joint; the driver must publish it')
            if (share >= RULE).any():
                worst = int(np.argmax(share))
                good = ','.join(np.array(self.joints)[share < RULE])
                raise BagError(
                    f'{self.where}: {what} of joint {self.joints[worst]} is missing, NaN or '
                    f'beyond {IMPOSSIBLE:g} in '
                    f'{int(bad[:, worst].sum())} of {len(values)} messages; leave it out with '
                    f'--joints {good}')
        self._keep(np.isfinite(self.q).all(axis=1) & np.isfinite(self.tau).all(axis=1),
                   NOT_FINITE)
        zero = ~self.tau.any(axis=0)
        if zero.all():
            raise BagError(f'{self.where}: effort is 0 throughout, for every joint; the driver '
                           f'does not measure it')
        for joint in np.array(self.joints)[zero]:
            self.notes.append(zero_effort_note(joint))

    def _check_jumps(self) -> None:
        if jumps_to_and_fro(self.q):
            raise BagError(f'{self.where}: positions jump to and fro from message to message, as '
                           f'when two robots publish the same joint names on one topic; give '
                           f'each a namespace and record again')

    def _unmeasured(self, options: ReadOptions) -> BoolArray:
        """Return the joints (N,) whose velocity must come from the position."""
        if options.differentiate:
            return np.ones(len(self.joints), dtype=bool)
        unmeasured = (~np.isfinite(self.qd)).mean(axis=0) >= RULE
        self._keep(np.isfinite(self.qd[:, ~unmeasured]).all(axis=1), VELOCITY)
        moves = np.ptp(self.q, axis=0) > MOVES
        self.notes += zero_velocity_notes(self.joints, moves, self.qd.any(axis=0) | unmeasured)
        return unmeasured

    def _clock(self) -> NDArray[np.int64]:
        """Choose the clock, and drop what does not come later than all before it."""
        clock = self.stamp_ns
        backwards = np.count_nonzero(~_rising(clock))
        if backwards > BAD_STAMPS * clock.size:
            unset = 'are not set' if not clock.any() else 'do not increase'
            self.notes.append(f'header stamps {unset}: time is the time of recording')
            clock = self.log_ns
        rising = _rising(clock)
        self._keep(rising, TIME)
        self.times = clock[rising]
        return self.times

    def _differentiate(self, clock: NDArray[np.int64], unmeasured: BoolArray) -> None:
        if not unmeasured.any():
            return
        self.qd[:, unmeasured] = differentiate((clock - clock[0]) / 1e9, self.q[:, unmeasured])
        known = np.isfinite(self.qd).all(axis=1)
        self.times = self.times[known]
        self._keep(known, LONELY)
        which = ('of every joint' if unmeasured.all()
                 else 'of ' + ', '.join(np.array(self.joints)[unmeasured]))
        self.notes.append(f'velocity {which} is differentiated from the position (zero phase)')


def read_report(path: Path, topic: str, n_messages: int, t: FloatArray,
                dropped: Mapping[str, int], velocity: str, start_ns: int,
                scale: Mapping[str, float], notes: Sequence[str]) -> ReadReport:
    """
    Return the report on samples at times t (M,) in s from the first of them.

    :param scale: N·m per unit of effort of every joint.
    """
    steps = np.diff(t)
    return ReadReport(
        path, topic, n_messages, len(t), dict(dropped), velocity,
        float(1 / np.median(steps)) if steps.size else 0.0, float(t[-1]), start_ns,
        fingerprint(path), {joint: value for joint, value in scale.items() if value != 1.0},
        tuple(notes))


def _rising(values: NDArray[np.int64]) -> BoolArray:
    """Return which values are greater than all before them."""
    before = np.maximum.accumulate(values)
    return np.append(np.ones(min(1, values.size), dtype=bool), values[1:] > before[:-1])


def listed(dropped: Mapping[str, int]) -> str:
    """Return how many messages were dropped for which reason, in words."""
    return ', '.join(f'{count} {reason}' for reason, count in dropped.items())
