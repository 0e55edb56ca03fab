"""
JointState messages decoded many at a time, where they repeat one layout of bytes.

A publisher sends the same joints in the same order with every message, so that all its messages
have their numbers at the same places. The first message of a kind is decoded by the general
decoder and becomes a template; the messages whose lengths and names are byte for byte those of
the template are decoded together, by looking at whole columns of bytes. All others are decoded
one by one.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.recordings.joint_state_cdr import JointStateDecoder, JointStateMessage, Spans
from gravity_comp_ros.recordings.message_batch import Batch, Bytes, Places
import numpy as np
from numpy.typing import NDArray

_STAMP = 4  # where seconds and nanoseconds begin, after the bytes that name the encoding
# Templates kept; more kinds of messages on one topic are no longer worth comparing with all.
_MOST = 16


@dataclass(frozen=True, eq=False)
class Block:
    """
    Messages of a batch with one sequence of names: stamps (M,) in ns and values (M, any).

    `which` (M,) are their numbers in the batch; an array that the sender left empty is (M, 0).
    """

    which: Places
    names: tuple[str, ...]
    stamp_ns: Places
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray


class _Template:
    """The layout of one message: what must be equal, and where the numbers are."""

    def __init__(self, raw: bytes, message: JointStateMessage, spans: Spans) -> None:
        self.length, self.names = len(raw), message.names
        self._order = '<' if raw[1] == 1 else '>'
        fixed = [(0, _STAMP), (_STAMP + 8, _STAMP + 12), spans.names]
        fixed += [(count, count + 4) for count, _, _ in spans.arrays]
        whole = np.frombuffer(raw, dtype=np.uint8)
        self._fixed = [(begin, whole[begin:end]) for begin, end in fixed]
        self._values = [(begin, size) for _, begin, size in spans.arrays]

    def matching(self, rows: Bytes) -> BoolArray:
        """Return which rows (M, length) have this layout, shape (M,)."""
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
    """Decode the batches of one topic; templates are kept from batch to batch."""

    def __init__(self) -> None:
        self._templates: list[_Template] = []
        self._single = JointStateDecoder()

    def decode(self, batch: Batch) -> Iterator[Block]:
        """Yield the messages of a batch that can be decoded; the others are in no block."""
        left = np.arange(len(batch))
        for template in self._templates:
            left = yield from self._matched(template, batch, left)
            if not left.size:
                return
        while left.size:
            raw, first, left = batch.message(int(left[0])), left[:1], left[1:]
            try:
                message, spans = self._single.decode(raw)
            except ValueError:
                continue
            yield Block(first, message.names, np.array([message.stamp_ns]),
                        *(np.asarray(values, dtype=np.float64)[None, :] for values in (
                            message.position, message.velocity, message.effort)))
            if len(self._templates) < _MOST and left.size:
                template = _Template(raw, message, spans)
                self._templates.append(template)
                left = yield from self._matched(template, batch, left)

    @staticmethod
    def _matched(template: _Template, batch: Batch,
                 left: Places) -> Generator[Block, None, Places]:
        """Yield the messages among `left` that fit a template; return the others."""
        same = batch.length[left] == template.length
        which = left if same.all() else left[same]
        if not which.size:
            return left
        rows = batch.rows(which, template.length)
        fits = template.matching(rows)
        if fits.all():
            yield template.block(which, rows)
            return left[~same]
        if fits.any():
            yield template.block(which[fits], rows[fits])
        same[same] = fits
        return left[~same]
