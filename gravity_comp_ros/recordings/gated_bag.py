"""
Streaming reader with slow-motion gate, for recordings of any length.

One pass assumes that the first message has all joints, velocities are measured, stamps increase,
and few messages have defects. If an assumption turns out wrong, the recording is read by
`read_bag` instead. The result is that of `read_bag` and `slow_samples` in both cases.
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
    BAD_STAMPS, MIN_TRAVEL, MISSING, NOT_FINITE, OTHER_JOINTS, read_report, TIME, VELOCITY)
from gravity_comp_ros.recordings.joint_columns import Columns
from gravity_comp_ros.recordings.message_layout import LayoutDecoder
from gravity_comp_ros.recordings.read_notes import (
    degree_notes, gap_notes, mask_out_of_range, zero_effort_note, zero_velocity_notes)
from gravity_comp_ros.recordings.several_arms import arms_by_name, positions_alternate
from gravity_comp_ros.recordings.storage import open_storage
from gravity_comp_ros.recordings.storage_interface import Storage
from gravity_comp_ros.recordings.topic_choice import choose_topic, COMMON_DEFECT
import numpy as np
from numpy.typing import NDArray

# Minimum number of messages for an early estimate of the share of defects.
_MIN_MESSAGES = 1000


@dataclass(frozen=True)
class GatedRecording:
    """
    Samples of one bag that passed the gate, and the number dropped by reason.

    `report.n_samples` is the number of samples before the gate.
    """

    samples: JointSamples
    report: ReadReport
    dropped: dict[str, int]


class _NotStreamableError(Exception):
    """An assumption of the streaming reader does not hold."""


def read_gated(path: str | Path, options: ReadOptions = ReadOptions(),
               gate: GateOptions = GateOptions()) -> GatedRecording:
    """
    Return the slow samples of one bag, with bounded memory for most recordings.

    Recordings without velocities or with bad stamps are read into memory as a whole.

    :raises BagError: as `read_bag`.
    :raises ModelMismatchError: as `read_bag`.
    :raises OptionError: if the number of thresholds of the gate is not the number of joints.
    """
    path = Path(path)
    try:
        with open_storage(path) as storage:
            topic, notes = choose_topic(path, storage, options.topic)
            reader = _StreamingReader(options, gate, _first_joints(storage, topic, options))
            reader.run(storage, topic)
        return reader.recording(path, topic, notes)
    except (_NotStreamableError, OptionError):  # errors of `read_bag` precede those of the gate
        whole = read_bag(path, options)
        gated = slow_samples(whole.samples, gate)
        return GatedRecording(gated.samples, whole.report, dict(gated.dropped))


def _first_joints(storage: Storage, topic: str, options: ReadOptions) -> tuple[str, ...]:
    if options.joints is not None:
        return options.joints
    for batch in storage.batches(topic):
        columns = Columns(options.rename)
        columns.add(batch, LayoutDecoder().decode(batch))
        if len(columns):
            if arms_by_name(columns.names):
                raise _NotStreamableError
            return columns.names
    raise _NotStreamableError


class _StreamingReader:
    """Pass over the messages that counts defects and keeps the slow samples."""

    def __init__(self, options: ReadOptions, gate: GateOptions, joints: tuple[str, ...]) -> None:
        if options.differentiate:
            raise _NotStreamableError
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
                self._clean(columns)
            if (self._messages > _MIN_MESSAGES
                    and len(self._times) < COMMON_DEFECT * self._messages):
                raise _NotStreamableError

    def _clean(self, columns: Columns) -> None:
        present = columns.presence(self._joints)
        q, qd, tau = columns.values(self._joints)
        if mask_out_of_range(q, qd, tau):
            raise _NotStreamableError
        if self._options.degrees:
            q, qd = np.radians(q), np.radians(qd)
        if not self._times and positions_alternate(q):
            raise _NotStreamableError
        keep = np.ones(len(columns), dtype=bool)
        finite = np.isfinite(q).all(axis=1) & np.isfinite(tau).all(axis=1)
        for reason, valid in ((OTHER_JOINTS, present.any(axis=1)), (MISSING, present.all(axis=1)),
                              (NOT_FINITE, finite), (VELOCITY, np.isfinite(qd).all(axis=1))):
            self._drop(keep, valid, reason)
        stamps = columns.stamp_ns
        before = np.maximum.accumulate(np.where(keep, stamps, self._latest))
        before = np.concatenate([[self._latest], np.maximum(before, self._latest)[:-1]])
        self._drop(keep, np.greater(stamps, before), TIME)
        if keep.any():
            self._gate_samples(stamps[keep], q[keep], qd[keep], tau[keep])

    def _drop(self, keep: BoolArray, valid: BoolArray | np.bool_, reason: str) -> None:
        """Clear `keep` (M,) of invalid messages, in place, and count them."""
        lost = int((keep & ~valid).sum())
        if lost:
            self._dropped[reason] += lost
            keep &= valid

    def _gate_samples(self, stamps: NDArray[np.int64], q: FloatArray, qd: FloatArray,
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
        self._check_assumptions()
        t, q, qd, tau = (np.concatenate(parts) for parts in zip(*self._kept))
        scale = self._options.scale(self._joints)
        samples = JointSamples.single_run(
            self._joints, t, q, qd, tau * list(scale.values()),
            path.name or path.resolve().name, self._times[0] / 1e9)
        notes = [*notes, *(zero_effort_note(joint)
                           for joint, loaded in zip(self._joints, self._loaded) if not loaded)]
        notes += zero_velocity_notes(self._joints, self._high - self._low > MIN_TRAVEL,
                                     self._moving)
        times = (np.frombuffer(self._times, dtype=np.int64) - self._times[0]) / 1e9
        notes += gap_notes(times)
        largest = float(max(self._high.max(), -self._low.min()))
        notes += degree_notes(largest, self._options.degrees)
        report = read_report(path, topic, self._messages, times, self._dropped, 'measured',
                             self._times[0], scale, notes)
        return GatedRecording(samples, report, dict(self._gate.dropped))

    def _check_assumptions(self) -> None:
        known = self._names | set(self._joints)
        valid = (
            bool(self._times) and set(self._joints) <= self._names
            and (self._options.joints is not None or self._names <= set(self._joints))
            and set(self._options.effort_scale) <= known and bool(self._loaded.any())
            and set(self._options.rename) <= self._recorded)
        remaining = self._messages - sum(
            self._dropped[reason] for reason in self._dropped.keys() - {
                OTHER_JOINTS, MISSING, NOT_FINITE, VELOCITY, TIME})
        for reason, limit in ((OTHER_JOINTS, 1.0), (MISSING, COMMON_DEFECT),
                              (NOT_FINITE, COMMON_DEFECT), (VELOCITY, COMMON_DEFECT),
                              (TIME, BAD_STAMPS)):
            # A defect that is rare over all joints together is rare for each joint.
            valid = valid and self._dropped[reason] <= limit * remaining * (1 - 1e-9)
            remaining -= self._dropped[reason]
        if not valid:
            raise _NotStreamableError
