"""
Recordings of any length, gated while they are read: what the gate drops is never kept.

One pass takes for granted what nearly every recording fulfils: its joints are those of its first
message, velocities are measured, stamps increase, and few messages have a defect. Whether that
held is known at the end; if it did not, the recording is read as a whole, by the rules of
`read_bag`. So the answer is that of `read_bag` and `slow_samples` either way.
"""

from __future__ import annotations

from array import array
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from gravity_comp_ros.data.gate import BlockGate, GateOptions, slow_samples
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions, ReadReport
from gravity_comp_ros.recordings.cleaning import (
    BAD_STAMPS, MISSING, MOVES, NOT_FINITE, OTHER_JOINTS, read_report, TIME, VELOCITY)
from gravity_comp_ros.recordings.joint_columns import Columns
from gravity_comp_ros.recordings.message_layout import LayoutDecoder
from gravity_comp_ros.recordings.read_notes import (
    degree_notes, drop_impossible, gap_notes, zero_effort_note, zero_velocity_notes)
from gravity_comp_ros.recordings.several_arms import arms_by_name, jumps_to_and_fro
from gravity_comp_ros.recordings.storage import open_storage
from gravity_comp_ros.recordings.storage_interface import Storage
from gravity_comp_ros.recordings.topic_choice import choose_topic, RULE
import numpy as np
from numpy.typing import NDArray

_UNDECIDED = 1000  # messages that say nothing yet about how common a defect is


@dataclass(frozen=True)
class GatedRecording:
    """
    What the gate kept of one bag; `report.n_samples` counts what it was offered.

    `dropped` counts what the gate dropped, by reason.
    """

    samples: JointSamples
    report: ReadReport
    dropped: dict[str, int]


class _UnusualError(Exception):
    """The recording must be read as a whole before it can be judged."""


def read_gated(path: str | Path, options: ReadOptions = ReadOptions(),
               gate: GateOptions = GateOptions()) -> GatedRecording:
    """
    Return the slow samples of one bag, in little memory however long it is.

    Only recordings without velocities or without usable stamps are held in memory whole.

    :raises BagError: as `read_bag`.
    :raises ModelMismatchError: as `read_bag`.
    :raises OptionError: if the gate holds another number of thresholds than joints.
    """
    path = Path(path)
    try:
        with open_storage(path) as storage:
            topic, notes = choose_topic(path, storage, options.topic)
            passed = _Pass(options, gate, _first_joints(storage, topic, options))
            passed.run(storage, topic)
        return passed.recording(path, topic, notes)
    except (_UnusualError, OptionError):  # a gate for other joints is told of after other errors
        whole = read_bag(path, options)
        kept = slow_samples(whole.samples, gate)
        return GatedRecording(kept.samples, whole.report, dict(kept.dropped))


def _first_joints(storage: Storage, topic: str, options: ReadOptions) -> tuple[str, ...]:
    if options.joints is not None:
        return options.joints
    for batch in storage.batches(topic):
        columns = Columns(options.rename)
        columns.add(batch, LayoutDecoder().decode(batch))
        if len(columns):
            if arms_by_name(columns.names):
                raise _UnusualError
            return columns.names
    raise _UnusualError


class _Pass:
    """One pass over the messages: the defects counted, the slow samples kept."""

    def __init__(self, options: ReadOptions, gate: GateOptions, joints: tuple[str, ...]) -> None:
        if options.differentiate:
            raise _UnusualError
        self._options, self._joints = options, joints
        self._gate = BlockGate(len(joints), gate)
        self._dropped: Counter[str] = Counter()
        self._names: set[str] = set()
        self._recorded: set[str] = set()
        self._messages = 0
        self._times = array('q')
        self._latest = -2**63
        self._low, self._high = np.full(len(joints), np.inf), np.full(len(joints), -np.inf)
        self._loaded = np.zeros(len(joints), dtype=bool)
        self._moving = np.zeros(len(joints), dtype=bool)
        self._kept: list[tuple[FloatArray, ...]] = []

    def run(self, storage: Storage, topic: str) -> None:
        decoder = LayoutDecoder()
        for batch in storage.batches(topic):
            columns = Columns(self._options.rename)
            columns.add(batch, decoder.decode(batch))
            self._recorded.update(columns.recorded)
            self._messages += len(batch)
            self._dropped.update(columns.dropped)
            self._names.update(columns.names)
            if len(columns):
                self._take(columns)
            if self._messages > _UNDECIDED and len(self._times) < RULE * self._messages:
                raise _UnusualError

    def _take(self, columns: Columns) -> None:
        present = columns.presence(self._joints)
        q, qd, tau = columns.values(self._joints)
        if drop_impossible(q, qd, tau):
            raise _UnusualError
        if self._options.degrees:
            q, qd = np.radians(q), np.radians(qd)
        if not self._times and jumps_to_and_fro(q):
            raise _UnusualError
        keep = np.ones(len(columns), dtype=bool)
        finite = np.isfinite(q).all(axis=1) & np.isfinite(tau).all(axis=1)
        for reason, fine in ((OTHER_JOINTS, present.any(axis=1)), (MISSING, present.all(axis=1)),
                             (NOT_FINITE, finite), (VELOCITY, np.isfinite(qd).all(axis=1))):
            self._drop(keep, fine, reason)
        stamps = columns.stamp_ns
        before = np.maximum.accumulate(np.where(keep, stamps, self._latest))
        before = np.concatenate([[self._latest], np.maximum(before, self._latest)[:-1]])
        self._drop(keep, np.greater(stamps, before), TIME)
        if keep.any():
            self._use(stamps[keep], q[keep], qd[keep], tau[keep])

    def _drop(self, keep: BoolArray, fine: BoolArray | np.bool_, reason: str) -> None:
        lost = int((keep & ~fine).sum())
        if lost:
            self._dropped[reason] += lost
            keep &= fine

    def _use(self, stamps: NDArray[np.int64], q: FloatArray, qd: FloatArray,
             tau: FloatArray) -> None:
        self._latest = int(stamps[-1])
        self._times.frombytes(stamps.tobytes())
        self._low = np.minimum(self._low, q.min(axis=0))
        self._high = np.maximum(self._high, q.max(axis=0))
        self._loaded |= tau.any(axis=0)
        self._moving |= qd.any(axis=0)
        t = (stamps - self._times[0]) / 1e9
        slow = self._gate.offer(t, qd)
        self._kept.append((t[slow], q[slow], qd[slow], tau[slow]))

    def recording(self, path: Path, topic: str, notes: list[str]) -> GatedRecording:
        self._check()
        t, q, qd, tau = (np.concatenate(parts) for parts in zip(*self._kept))
        scale = self._options.scale(self._joints)
        samples = JointSamples.single_run(
            self._joints, t, q, qd, tau * list(scale.values()),
            path.name or path.resolve().name, self._times[0] / 1e9)
        notes = [*notes, *(zero_effort_note(joint)
                           for joint, loaded in zip(self._joints, self._loaded) if not loaded)]
        notes += zero_velocity_notes(self._joints, self._high - self._low > MOVES, self._moving)
        times = (np.frombuffer(self._times, dtype=np.int64) - self._times[0]) / 1e9
        notes += gap_notes(times)
        furthest = float(max(self._high.max(), -self._low.min()))
        notes += degree_notes(furthest, self._options.degrees)
        report = read_report(path, topic, self._messages, times, self._dropped, 'measured',
                             self._times[0], scale, notes)
        return GatedRecording(samples, report, dict(self._gate.dropped))

    def _check(self) -> None:
        """Give up what took for granted what turned out to be otherwise."""
        known = self._names | set(self._joints)
        usual = (
            bool(self._times) and set(self._joints) <= self._names
            and (self._options.joints is not None or self._names <= set(self._joints))
            and set(self._options.effort_scale) <= known and bool(self._loaded.any())
            and set(self._options.rename) <= self._recorded)
        left = self._messages - sum(self._dropped[reason] for reason in self._dropped.keys() - {
            OTHER_JOINTS, MISSING, NOT_FINITE, VELOCITY, TIME})
        for reason, most in ((OTHER_JOINTS, 1.0), (MISSING, RULE), (NOT_FINITE, RULE),
                             (VELOCITY, RULE), (TIME, BAD_STAMPS)):
            # Where a defect is rare over all joints together, it is rare for each of them.
            usual = usual and self._dropped[reason] <= most * left * (1 - 1e-9)
            left -= self._dropped[reason]
        if not usual:
            raise _UnusualError
