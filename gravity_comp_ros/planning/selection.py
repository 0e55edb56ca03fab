"""Selection of candidate parts: greedy by utility per time, then each part again."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.planning.candidates import Part
from gravity_comp_ros.planning.criterion import Criterion
from gravity_comp_ros.planning.segments import duration, Line
from gravity_comp_ros.planning.workspace import Workspace
import numpy as np

# Smallest gain in utility that counts.
_MIN_GAIN = 0.02
# A part informs about a target if its gain is at least this share of its largest.
_MIN_GAIN_SHARE = 0.3


class Selection:
    """
    Parts of largest utility together with the recordings, in at most `seconds`.

    No part comes twice: repetition averages noise, but not unmodelled torque at its poses.
    """

    def __init__(self, space: Workspace, criterion: Criterion, parts: Sequence[Part],
                 seconds: float) -> None:
        self._space, self._criterion, self._seconds = space, criterion, seconds
        self._candidates = [part for part in parts if _duration([part]) <= seconds]
        self._added = criterion.sums.added([part.lines for part in self._candidates])
        recorded = criterion.sums.recorded[None]
        self._gains = criterion.utilities(recorded + self._added) - criterion.utilities(recorded)
        self._clear: dict[int, bool] = {}
        chosen = self._grown([])
        # Gain by time prefers short parts: each is exchanged for one of the largest gain.
        for number in list(chosen):
            rest = [k for k in chosen if k != number]
            best = self._best(rest, by_time=False)
            other = chosen if best is None else self._grown([*rest, best])
            if self._utility(other) > self._utility(chosen) + _MIN_GAIN:
                chosen = other
        # Parts from one base follow each other.
        self.parts = [self._candidates[k] for k in chosen]
        self.parts = [part for way in dict.fromkeys(part.way for part in self.parts)
                      for part in self.parts if part.way == way]

    def motion(self) -> tuple[list[Line], list[tuple[float, float]]]:
        """Return the lines from start to start, and start and end time in s of each part."""
        lines: list[Line] = []
        times = []
        for way, parts in groupby(self.parts, lambda part: part.way):
            lines += way
            for part in parts:
                begin = duration(lines)
                lines += part.lines
                times.append((begin, duration(lines)))
            lines += [Line(line.end, line.start, line.limits) for line in way]
        return lines, times

    def informs(self, part: Part) -> list[int]:
        """Return the numbers of the questions about which a part alone gives information."""
        gains = self._gains[self._candidates.index(part)]
        return [k for k, gain in enumerate(gains)
                if gain > max(_MIN_GAIN, _MIN_GAIN_SHARE * gains.max())]

    def _grown(self, chosen: list[int]) -> list[int]:
        """Return chosen parts with others of largest gain per time, until none has a gain."""
        while (best := self._best(chosen)) is not None:
            chosen = [*chosen, best]
        return chosen

    def _best(self, chosen: list[int], by_time: bool = True) -> int | None:
        """Return the part of largest gain, or gain per time; None without a gain."""
        used = self._time(chosen)
        times = {k: self._time([*chosen, k]) - used for k in range(len(self._candidates))
                 if k not in chosen}
        fits = [k for k, time in times.items() if used + time <= self._seconds]
        if not fits:
            return None
        gains = self._criterion.utilities(self._sums(chosen) + self._added[fits]).sum(axis=1)
        gains -= self._utility(chosen)
        rates = gains / [times[k] for k in fits] if by_time else gains
        return next((fits[k] for k in np.argsort(-rates)
                     if gains[k] > _MIN_GAIN and self._is_clear(fits[k])), None)

    def _sums(self, chosen: Sequence[int]) -> FloatArray:
        """Return the sums (1, L, L) of the recordings and of chosen parts."""
        return np.asarray(self._criterion.sums.recorded + self._added[list(chosen)].sum(
            axis=0, keepdims=True))

    def _utility(self, chosen: Sequence[int]) -> float:
        return float(self._criterion.utilities(self._sums(chosen)).sum())

    def _time(self, chosen: Sequence[int]) -> float:
        return _duration([self._candidates[k] for k in chosen])

    def _is_clear(self, k: int) -> bool:
        """Return whether a part is free of collisions."""
        if k not in self._clear:
            self._clear[k] = self._space.is_clear(self._candidates[k].stops)
        return self._clear[k]


def _duration(parts: Sequence[Part]) -> float:
    """Return the duration of parts with the ways to their bases and back, s."""
    return (sum(part.duration for part in parts)
            + 2.0 * sum(map(duration, {part.way for part in parts})))
