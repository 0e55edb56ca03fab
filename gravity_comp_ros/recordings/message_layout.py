"""
Vectorised decoding of JointState messages with the same byte layout.

A publisher usually sends the same joints in the same order, so that the numbers have the same
offsets in all its messages. The first message of a layout is decoded by the general decoder and
becomes a template. Messages with the length and the names of the template are decoded together,
by columns of bytes. Other messages are decoded one by one.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.recordings.joint_state_cdr import JointStateDecoder, JointStateMessage, Spans
from gravity_comp_ros.recordings.messages import Batch, Bytes, Places
import numpy as np
from numpy.typing import NDArray

# Offset of the stamp (seconds, nanoseconds) after the header of CDR or the number of ROS 1, bytes.
_STAMP = 4
# Maximum number of templates that messages are compared with.
_MAX_TEMPLATES = 16


@dataclass(frozen=True, eq=False)
class Block:
    """
    Messages of a batch with the same names: stamps (M,) in ns and values (M, any).

    `which` (M,) are their indices in the batch. Empty arrays of the messages are (M, 0).
    """

    which: Places
    names: tuple[str, ...]
    stamp_ns: Places
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray


class _Template:
    """Layout of a message: bytes that must be equal, and offsets of the numbers."""

    def __init__(self, raw: bytes, message: JointStateMessage, spans: Spans,
                 ros1: bool) -> None:
        self.length, self.names = len(raw), message.names
        self._order = '<' if ros1 or raw[1] == 1 else '>'
        # ROS 1 counts its messages where CDR has its header.
        fixed = [(0, 0 if ros1 else _STAMP), (_STAMP + 8, _STAMP + 12), spans.names]
        fixed += [(count, count + 4) for count, _, _ in spans.arrays]
        whole = np.frombuffer(raw, dtype=np.uint8)
        self._fixed = [(begin, whole[begin:end]) for begin, end in fixed]
        self._values = [(begin, size) for _, begin, size in spans.arrays]

    def matching(self, rows: Bytes) -> BoolArray:
        """Return the mask (M,) of the rows (M, length) with this layout."""
        equal = np.ones(len(rows), dtype=bool)
        for begin, expected in self._fixed:
            equal &= (rows[:, begin:begin + len(expected)] == expected).all(axis=1)
        return equal

    def block(self, which: Places, rows: Bytes) -> Block:
        seconds = self._numbers(rows, _STAMP, 'i4', 1)[:, 0].astype(np.int64)
        nanoseconds = self._numbers(rows, _STAMP + 4, 'u4', 1)[:, 0]
        values = [self._numbers(rows, begin, 'f8', size).astype(np.float64, copy=False)
                  for begin, size in self._values]
        return Block(which, self.names, seconds * 10**9 + nanoseconds, *values)

    def _numbers(self, rows: Bytes, begin: int, kind: str, size: int) -> NDArray:
        width = size * int(kind[1])
        part = np.ascontiguousarray(rows[:, begin:begin + width])
        return part.view(self._order + kind).reshape(len(rows), size)


class LayoutDecoder:
    """Decoder for the batches of one topic, of ROS 2 or 1; all batches share templates."""

    def __init__(self, ros1: bool = False) -> None:
        self._templates: list[_Template] = []
        self._ros1 = ros1
        self._single = JointStateDecoder(ros1)

    def decode(self, batch: Batch) -> Iterator[Block]:
        """Yield the messages of a batch; undecodable ones are in no block."""
        remaining = np.arange(len(batch))
        for template in self._templates:
            remaining = yield from self._matched(template, batch, remaining)
            if not remaining.size:
                return
        while remaining.size:
            raw = batch.message(int(remaining[0]))
            first, remaining = remaining[:1], remaining[1:]
            try:
                message, spans = self._single.decode(raw)
            except ValueError:
                continue
            yield Block(first, message.names, np.array([message.stamp_ns]),
                        *(np.asarray(values, dtype=np.float64)[None, :] for values in (
                            message.position, message.velocity, message.effort)))
            if len(self._templates) < _MAX_TEMPLATES and remaining.size:
                template = _Template(raw, message, spans, self._ros1)
                self._templates.append(template)
                remaining = yield from self._matched(template, batch, remaining)

    @staticmethod
    def _matched(template: _Template, batch: Batch,
                 candidates: Places) -> Generator[Block, None, Places]:
        """Yield the candidates that match a template; return the others."""
        same = batch.length[candidates] == template.length
        which = candidates if same.all() else candidates[same]
        if not which.size:
            return candidates
        rows = batch.rows(which, template.length)
        matching = template.matching(rows)
        if matching.all():
            yield template.block(which, rows)
            return candidates[~same]
        if matching.any():
            yield template.block(which[matching], rows[matching])
        same[same] = matching
        return candidates[~same]
