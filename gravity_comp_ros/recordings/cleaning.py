"""
Conversion of the columns of a topic to samples; defects are dropped and counted, or refused.

Messages that are not of the arm's driver are such a defect: several publishers may send the same
joints on one topic.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.facts.fact import Action, Fact, Kind, refused, unless_accepted
from gravity_comp_ros.facts.judge import judge
from gravity_comp_ros.facts.options import FACTS
from gravity_comp_ros.facts.signals import Signals
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.joint_columns import Columns
from gravity_comp_ros.recordings.read_options import ReadOptions, ReadReport, Recording
from gravity_comp_ros.recordings.storage import fingerprint
import numpy as np
from numpy.typing import ArrayLike, NDArray

OTHER_JOINTS = 'other joints only'
MISSING = 'joint missing'
NOT_FINITE = 'position or effort missing or not finite'
VELOCITY = 'velocity missing or not finite'
TIME = 'time goes back or stands still'
ISOLATED = 'alone in a gap, no velocity'


class Cleaning:
    """
    Steps from columns to samples; each step may drop messages and add facts.

    :param facts: facts known before.
    """

    def __init__(self, where: str, columns: Columns, joints: tuple[str, ...], notes: list[str],
                 facts: list[Fact], options: ReadOptions) -> None:
        self.where, self.joints, self.notes, self.facts = where, joints, notes, facts
        self.options = options
        self.dropped = Counter(columns.dropped)
        columns.put_in_order(FACTS.max_steps)
        self.log_ns, self.stamp_ns = columns.log_ns, columns.stamp_ns
        self.present = columns.presence(joints)
        self.q, self.qd, self.tau = columns.values(joints)
        for column in (*self.q.T, *self.qd.T, *self.tau.T):
            column[np.abs(column) > FACTS.max_magnitude] = np.nan
        sign, unit, zero = options.to_model(joints)
        if zero.any() or (sign * unit != 1.0).any():
            self.q, self.qd = sign * (unit * self.q - zero), sign * unit * self.qd
            self.tau = sign * self.tau
        second, fact = _second_publisher(columns, joints, self.q, self.tau)
        if fact is not None:
            self.facts.append(unless_accepted(fact, options.accept))
            second &= fact.kind not in options.accept
        self._keep(~second, NOT_FINITE if fact is None else fact.kind)
        self._keep(self.present.any(axis=1), OTHER_JOINTS)
        self._note_missing()
        self._keep(self.present.all(axis=1), MISSING)

    def recording(self, path: Path, topic: str, n_messages: int) -> Recording:
        """
        Return the samples and the report.

        :raises BagError: if at least half of the messages have the same defect, or the signals
            are refused.
        """
        self._check_values()
        missing = self._missing_velocities()
        self._choose_clock()
        self._check_jumps()
        times = self.times[self.rows]
        start = int(times[0])
        scale = self.options.scale(self.joints)
        time = (times - start) / 1e9
        self.notes += gap_notes(time)
        signals = Signals(
            self.joints, time, self._release('q'), self._release('qd'),
            self._release('tau'), self.rows)
        judged = judge(signals, np.array(list(scale.values())), missing,
                       self.options.joints is not None, self.options.accept)
        del signals
        self.dropped.update(judged.left_out)
        self.facts += judged.facts
        self._refuse()
        finite: BoolArray = np.asarray(np.isfinite(judged.signals.qd).all(axis=1))
        if not finite.any():
            raise BagError(f'{path} has no usable message: no sample has a velocity')
        if not finite.all():
            self.dropped[ISOLATED] += int(np.count_nonzero(~finite))
        kept = judged.signals.keep(finite)
        first = int(self.times[kept.rows[0]])
        samples = _samples(kept, path, start / 1e9)
        steps = np.diff(samples.t)
        return Recording(samples, ReadReport(
            path, topic, n_messages, len(samples), dict(self.dropped),
            'differentiated' if judged.differentiated.any() else 'measured',
            float(1 / np.median(steps)) if steps.size else 0.0, float(samples.t[-1]), first,
            fingerprint(path), {name: scale[name] for name in samples.names
                                if scale[name] != 1.0},
            tuple(self.notes), tuple(self.facts), self.options))

    def _refuse(self) -> None:
        """Raise the refusals as one error, with the joints that were left out."""
        refusals = refused(self.facts)
        if not refusals or not self.options.refuse:
            return
        others = [fact for fact in self.facts if fact.action is Action.LEFT_OUT
                  and fact.kind in (Kind.GRIPPER, Kind.LINEAR_JOINT)]
        raise BagError(f'{self.where}: ' + '; '.join(
            fact.sentence for fact in (*refusals, *others)))

    def _release(self, name: str) -> NDArray[np.float64]:
        """Return an array and drop the reference to it, to keep one copy in memory."""
        values: NDArray[np.float64] = self.__dict__.pop(name)
        return values

    def _keep(self, keep: ArrayLike, reason: str) -> None:
        mask = np.asarray(keep, dtype=bool)
        lost = int(mask.size - np.count_nonzero(mask))
        if not lost:
            return
        self.dropped[reason] += lost
        for name in ('present', 'log_ns', 'stamp_ns', 'q', 'qd', 'tau'):
            setattr(self, name, getattr(self, name)[mask])
        if not self.log_ns.size:
            raise BagError(f'{self.where} has no usable message: {listed(self.dropped)}')

    def _note_missing(self) -> None:
        """Add a note on the joints that are missing in some messages."""
        for name, has in zip(self.joints, self.present.T):
            if not has.all():
                rows = np.flatnonzero(~has)
                begin, end = (self.log_ns[rows[[0, -1]]] - self.log_ns[0]) / 1e9
                self.notes.append(f'{name} is missing from {counted(len(rows), "message")}, '
                                  f'between {begin:.4g} and {end:.4g} s')

    def _check_values(self) -> None:
        """Refuse recordings without positions or torques; drop single invalid messages."""
        for what, values in (('position', self.q), ('effort', self.tau)):
            bad = ~np.isfinite(values)
            share = bad.mean(axis=0)
            worst = int(np.argmax(share))
            if share[worst] < FACTS.common:
                continue
            of, count, advice = f'joint {self.joints[worst]}', bad[:, worst].sum(), (
                f'leave it out with --joints '
                f'{",".join(np.array(self.joints)[share < FACTS.common])}')
            if (share >= FACTS.common).all():
                of, count, advice = 'every joint', bad.any(axis=1).sum(), (
                    'the driver must publish it')
            raise BagError(f'{self.where}: {what} of {of} is missing, NaN or beyond '
                           f'{FACTS.max_magnitude:g} in {count} of {len(values)} messages; '
                           f'{advice}')
        self._keep(np.isfinite(self.q).all(axis=1) & np.isfinite(self.tau).all(axis=1),
                   NOT_FINITE)

    def _check_jumps(self) -> None:
        """Refuse positions that alternate between two values."""
        for joint in self.q.T if len(self.q) >= 20 else ():
            step = np.median(np.abs(np.diff(joint)))
            back = np.median(np.abs(joint[2:] - joint[:-2]))
            if step > FACTS.min_motion and back < FACTS.smooth * step:
                raise BagError(
                    f'{self.where}: positions alternate between two values from message to '
                    f'message, as if two robots published the same joint names on one topic; give '
                    f'each robot a namespace and record again')

    def _missing_velocities(self) -> BoolArray:
        """Return the mask (N,) of joints whose velocity is computed from the position."""
        if self.options.differentiate:
            return np.ones(len(self.joints), dtype=bool)
        missing = np.asarray((~np.isfinite(self.qd)).mean(axis=0) >= FACTS.common)
        self._keep(np.isfinite(self.qd[:, ~missing]).all(axis=1), VELOCITY)
        return missing

    def _choose_clock(self) -> None:
        """Choose stamp or log time, and drop messages that are not later than all before."""
        clock = self.stamp_ns
        backwards = np.count_nonzero(~_rising(clock))
        if FACTS.max_outliers * clock.size < backwards > np.count_nonzero(
                ~_rising(self.log_ns)):
            unset = 'are not set' if not clock.any() else 'do not increase'
            self.notes.append(f'header stamps {unset}: the time of recording is used')
            clock = self.log_ns
        rising, latest = _rising(clock), np.maximum.accumulate(clock)
        back = latest - clock
        if back.any():
            self.notes.append(
                f'the clock goes back by {back.max() / 1e9:.4g} s, the first time after '
                f'{(latest[np.argmax(back > 0)] - clock[0]) / 1e9:.4g} s: '
                f'{counted(int((~rising).sum()), "message")} until it has caught up are left out')
        self._keep(rising, TIME)
        self.times, self.rows = clock, np.flatnonzero(rising)


def _samples(signals: Signals, path: Path, start: float) -> JointSamples:
    """
    Return the samples with time 0 at the first one.

    :param start: time on the clock in s at which t of the signals is 0.
    """
    arrays = [signals.t - signals.t[0], signals.q, signals.qd, signals.tau]
    for number, values in enumerate(arrays):
        # Read-only arrays that own their memory are not copied again.
        arrays[number] = values = values.copy() if values.base is not None else values
        values.flags.writeable = False
    t, q, qd, tau = arrays
    return JointSamples.single_run(signals.names, t, q, qd, tau,
                                   path.name or path.resolve().name, start + float(signals.t[0]))


def _rising(values: NDArray[np.int64]) -> BoolArray:
    """Return the mask of values greater than all values before them."""
    before = np.maximum.accumulate(values)
    return np.append(np.ones(min(1, values.size), dtype=bool), values[1:] > before[:-1])


def listed(dropped: Mapping[str, int]) -> str:
    """Return the number of dropped messages by reason, as text."""
    return ', '.join(f'{count} {reason}' for reason, count in dropped.items())


def gap_notes(t: FloatArray) -> list[str]:
    """
    Return a note on gaps that are too long for lost messages.

    :param t: increasing times (M,) in s.
    """
    steps = np.diff(t)
    if not steps.size:
        return []
    longest = int(np.argmax(steps))
    count = int((steps > max(FACTS.gap, FACTS.gap_steps * float(np.median(steps)))).sum())
    if not count:
        return []
    what = 'a gap of' if count == 1 else f'{count} gaps, the longest'
    return [f'{what} {steps[longest]:.4g} s, {t[longest]:.4g} s after the start: if the arm or '
            f'its load changed in between, cut the recording there']


def _second_publisher(columns: Columns, joints: Sequence[str], q: FloatArray,
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
    if few < FACTS.rare * relevant.sum() or few < 2:
        return nothing, None
    order = second[relevant]
    if np.count_nonzero(order[1:] != order[:-1]) < FACTS.common * few:
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
    return bool(np.nanmedian(step[changes]) > FACTS.min_motion)


def _efforts_fall(tau: FloatArray, second: BoolArray) -> bool:
    """Return whether efforts change by their usual size where the publisher changes."""
    size = np.abs(tau[~second]).max(axis=1)
    step = np.abs(np.diff(tau, axis=0)).max(axis=1)[second[1:] != second[:-1]]
    return bool(np.median(step) > FACTS.common * np.median(size))
