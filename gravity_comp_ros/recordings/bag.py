"""Read joint states from MCAP files, rosbag2 folders and bare .db3 files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import BagError, ModelMismatchError, OptionError
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.joint_columns import Columns
from gravity_comp_ros.recordings.message_layout import LayoutDecoder
from gravity_comp_ros.recordings.read_notes import (
    degree_notes, drop_impossible, gap_notes, IMPOSSIBLE, zero_effort_note, zero_velocity_notes)
from gravity_comp_ros.recordings.several_arms import jumps_to_and_fro
from gravity_comp_ros.recordings.storage import fingerprint, open_storage
from gravity_comp_ros.recordings.storage_interface import Storage
from gravity_comp_ros.recordings.topic_choice import (
    choose_joints, choose_topic, named_joints, RULE)
from gravity_comp_ros.recordings.units import TORQUE_UNITS
import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

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


@dataclass(frozen=True)
class ReadOptions:
    """
    What to read.

    `topic`: the JointState topic; if None, the only one there is, or `/joint_states`.
    `joints`: these, in this order; if None, all of them in the order of the first message.
    `effort_scale`: N·m per unit of effort by joint, sign included; 1 where not given.
    A joint is given by its name, or by its number from 1 in the order of the first message.
    `differentiate`: take speeds from positions although there are velocities.
    `degrees`: positions and velocities are in degrees.
    `effort_unit`: one of `TORQUE_UNITS`; the scale is N·m per unit beside it.
    `rename`: other names for joints, by the name in the recording; all else goes by these.

    :raises OptionError: if a scale is 0 or not finite, joints or new names repeat, or the unit
        is unknown.
    """

    topic: str | None = None
    joints: tuple[str, ...] | None = None
    effort_scale: Mapping[str, float] = field(default_factory=dict)
    differentiate: bool = False
    degrees: bool = False
    effort_unit: str = 'Nm'
    rename: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for joint, scale in self.effort_scale.items():
            if not np.isfinite(scale) or scale == 0:
                raise OptionError(f'effort scale of joint {joint} is {scale}; it must be finite '
                                  f'and not 0')
        if self.effort_unit not in TORQUE_UNITS:
            raise OptionError(f'effort unit {self.effort_unit!r} is not one of '
                              f'{", ".join(TORQUE_UNITS)}')
        if len(set(self.rename.values())) < len(self.rename):
            raise OptionError(f'two joints get the same name: {", ".join(self.rename.values())}')
        if self.joints is not None:
            if not self.joints:
                raise OptionError('no joints chosen')
            if len(set(self.joints)) < len(self.joints):
                raise OptionError(f'joints repeat: {", ".join(self.joints)}')

    def scale(self, joints: Sequence[str]) -> dict[str, float]:
        """Return N·m per unit of effort as recorded, sign included, for each joint."""
        unit = TORQUE_UNITS[self.effort_unit]
        return {joint: unit * float(self.effort_scale.get(joint, 1.0)) for joint in joints}


@dataclass(frozen=True)
class ReadReport:
    """
    How a recording became samples.

    `n_messages` were on `topic`, `n_samples` were kept, `dropped` counts the others by
    reason. `velocity` is 'measured' or 'differentiated'. `rate_hz` is one over the median
    interval; `start_ns` the time of the first sample since the epoch; `sha256` identifies
    the data. `effort_scale` are the N·m per unit by joint that were used, where not 1.
    """

    path: Path
    topic: str
    n_messages: int
    n_samples: int
    dropped: Mapping[str, int]
    velocity: str
    rate_hz: float
    duration_s: float
    start_ns: int
    sha256: str
    effort_scale: Mapping[str, float]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Recording:
    """One bag as one run of samples; time 0 is its first sample."""

    samples: JointSamples
    report: ReadReport


@dataclass(frozen=True)
class Recordings:
    """Several bags as runs of one set of samples."""

    samples: JointSamples
    reports: tuple[ReadReport, ...]


def read_bags(paths: Iterable[str | Path], options: ReadOptions = ReadOptions()) -> Recordings:
    """
    Return the samples of several bags, one run each; the first bag gives the order of joints.

    :raises BagError: as `read_bag`; if there is no path.
    :raises ModelMismatchError: if the joints of two bags differ.
    """
    recordings = [read_bag(path, options) for path in paths]
    if not recordings:
        raise BagError('no recording given')
    return Recordings(concatenate(r.samples for r in recordings),
                      tuple(r.report for r in recordings))


def read_bag(path: str | Path, options: ReadOptions = ReadOptions()) -> Recording:
    """
    Return the samples of one bag.

    Joints are matched by name, message by message. A message that cannot be used (joints
    missing, arrays of different lengths, duplicate names, NaN, time that does not increase)
    is dropped and counted. Time is the header's stamp if that increases, else the log time.
    Missing velocities come from the positions, by a filter without delay.

    :raises BagError: if there is no such recording, it is damaged, empty or without a
        JointState topic to read, or at least half of its messages share one defect.
    :raises ModelMismatchError: if a chosen or scaled joint is not in it.
    """
    path = Path(path)
    with open_storage(path) as storage:
        topic, notes = choose_topic(path, storage, options.topic)
        columns = _gather(storage, topic, options.rename)
    n_messages = len(columns) + sum(columns.dropped.values())
    where = f'{path}, topic {topic}'
    if not n_messages:
        raise BagError(f'{where} has no messages')
    if not len(columns):
        raise BagError(f'{where} has no usable message: {_listed(columns.dropped)}')
    unknown = [name for name in options.rename if name not in columns.recorded]
    if unknown:
        raise ModelMismatchError(f'{where} has no joint {", ".join(unknown)} (to be renamed); it '
                                 f'has {", ".join(sorted(columns.recorded))}')
    options = _by_name(where, columns.names, options)
    joints = choose_joints(where, columns, options.joints)
    reading = _Reading(where, columns, joints, notes, options.degrees)
    return reading.recording(path, topic, n_messages, options)


def _by_name(where: str, known: tuple[str, ...], options: ReadOptions) -> ReadOptions:
    """Return the options with joints by name where they were given by number."""
    scaled = named_joints(where, known, options.effort_scale, 'scaled')
    scale = dict(zip(scaled, options.effort_scale.values()))
    chosen = options.joints
    if chosen is not None:
        chosen = named_joints(where, known, chosen, 'chosen')
    return replace(options, joints=chosen, effort_scale=scale)


class _Reading:
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
        self._check_values()
        unmeasured = self._unmeasured(options)
        clock = self._clock()
        self._check_jumps()
        self._differentiate(clock, unmeasured)
        time = (self.times - self.times[0]) / 1e9
        scale = options.scale(self.joints)
        samples = JointSamples.single_run(
            self.joints, time, self.q, self.qd, self.tau * list(scale.values()),
            path.name or path.resolve().name, int(self.times[0]) / 1e9)
        steps = np.diff(time)
        self.notes += gap_notes(time)
        self.notes += degree_notes(np.abs(self.q).max(initial=0.0), self.degrees)
        report = ReadReport(
            path, topic, n_messages, len(samples), dict(self.dropped),
            'differentiated' if unmeasured.any() else 'measured',
            float(1 / np.median(steps)) if steps.size else 0.0, float(time[-1]),
            int(self.times[0]), fingerprint(path),
            {joint: value for joint, value in scale.items() if value != 1.0}, tuple(self.notes))
        return Recording(samples, report)

    def _keep(self, keep: ArrayLike, reason: str) -> None:
        mask = np.asarray(keep, dtype=bool)
        lost = int(mask.size - np.count_nonzero(mask))
        if not lost:
            return
        self.dropped[reason] += lost
        for name in ('log_ns', 'stamp_ns', 'q', 'qd', 'tau'):
            setattr(self, name, getattr(self, name)[mask])
        if not self.log_ns.size:
            raise BagError(f'{self.where} has no usable message: {_listed(self.dropped)}')

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

    def _unmeasured(self, options: ReadOptions) -> Mask:
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

    def _differentiate(self, clock: NDArray[np.int64], unmeasured: Mask) -> None:
        if not unmeasured.any():
            return
        self.qd[:, unmeasured] = differentiate((clock - clock[0]) / 1e9, self.q[:, unmeasured])
        known = np.isfinite(self.qd).all(axis=1)
        self.times = self.times[known]
        self._keep(known, LONELY)
        which = ('of every joint' if unmeasured.all()
                 else 'of ' + ', '.join(np.array(self.joints)[unmeasured]))
        self.notes.append(f'velocity {which} is differentiated from the position (zero phase)')


def _gather(storage: Storage, topic: str, rename: Mapping[str, str]) -> Columns:
    """Decode all messages of a topic."""
    columns, decoder = Columns(rename), LayoutDecoder()
    for batch in storage.batches(topic):
        columns.add(batch, decoder.decode(batch))
    return columns


def _rising(values: NDArray[np.int64]) -> Mask:
    """Return which values are greater than all before them."""
    before = np.maximum.accumulate(values)
    return np.append(np.ones(min(1, values.size), dtype=bool), values[1:] > before[:-1])


def _listed(dropped: Mapping[str, int]) -> str:
    return ', '.join(f'{count} {reason}' for reason, count in dropped.items())
