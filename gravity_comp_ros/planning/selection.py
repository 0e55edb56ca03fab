"""Selection of candidate parts: greedy by utility per time."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
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
        self._criterion, self._seconds = criterion, seconds
        self._candidates = [part for part in parts if _duration([part]) <= seconds]
        self._added = criterion.sums.added([part.lines for part in self._candidates])
        self._alone = self._gains([], slice(None))
        self._is_clear = cache(lambda k: space.is_clear(self._candidates[k].stops))
        chosen: list[int] = []
        while (best := self._best(chosen)) is not None:
            chosen.append(best)
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
        gains = self._alone[self._candidates.index(part)]
        return [k for k, gain in enumerate(gains)
                if gain > max(_MIN_GAIN, _MIN_GAIN_SHARE * gains.max())]

    def _best(self, chosen: list[int]) -> int | None:
        """Return the part of largest gain per time, None if none has a gain."""
        used = self._time(chosen)
        times = {k: self._time([*chosen, k]) - used for k in range(len(self._candidates))
                 if k not in chosen}
        fits = [k for k, time in times.items() if used + time <= self._seconds]
        if not fits:
            return None
        gains = self._gains(chosen, fits).sum(axis=1)
        return next((fits[k] for k in np.argsort(-gains / [times[k] for k in fits])
                     if gains[k] > _MIN_GAIN and self._is_clear(fits[k])), None)

    def _gains(self, chosen: list[int], others: list[int] | slice) -> FloatArray:
        """Return the gains (C, Q) in utility of other parts, each in addition to the chosen."""
        sums = self._criterion.sums.recorded + self._added[chosen].sum(axis=0)
        return (self._criterion.utilities(sums + self._added[others])
                - self._criterion.utilities(sums[None]))

    def _time(self, chosen: Sequence[int]) -> float:
        return _duration([self._candidates[k] for k in chosen])


def _duration(parts: Sequence[Part]) -> float:
    """Return the duration of parts with the ways to their bases and back, s."""
    return (sum(part.duration for part in parts)
            + 2.0 * sum(map(duration, {part.way for part in parts})))
