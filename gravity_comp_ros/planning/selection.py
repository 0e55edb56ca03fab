"""Selection of candidate parts: greedy by utility per time, then by exchange."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.planning.candidates import Part, travel
from gravity_comp_ros.planning.criterion import Criterion, identified
from gravity_comp_ros.planning.segments import Limits, sampled, Segment
from gravity_comp_ros.planning.workspace import Workspace
import numpy as np

_MAX_EXCHANGE_ROUNDS = 2
# Number of parts from which a selection is grown.
_SEEDS = 3
# Candidates that are scored together, and those that are tried in an exchange.
_TOGETHER, _TRIED = 16, 48
# Smallest gain in utility that counts.
_MIN_GAIN = 0.02
# A part informs about a target if its gain is at least this share of its largest.
_MIN_GAIN_SHARE = 0.3
# Shortest time by which a gain is divided, s.
_MIN_TIME = 0.5


class Selector:
    """Selects candidate parts by the utility of their sums and those of the recordings."""

    def __init__(self, space: Workspace, criterion: Criterion, parts: Sequence[Part],
                 limits: Limits, duration: float) -> None:
        self._space, self._criterion, self._limits = space, criterion, limits
        self._duration = duration
        self._travel_times: dict[bytes, float] = {}
        self._colliding: set[int] = set()
        self._parts = [part for part in parts if self._time([part]) <= duration]
        self._added = criterion.sums.added([part.segments for part in self._parts]) if (
            self._parts) else np.zeros((0, *criterion.sums.recorded.shape))

    def select(self) -> list[Part]:
        """
        Return the parts in the order in which they are played.

        No part comes twice: repetition averages noise, but not unmodelled torque at its poses.
        """
        if not self._parts:
            return []
        order = np.argsort(-self._alone).tolist()
        seeds = [[k] for k in order[:_SEEDS] if self._alone[k] > _MIN_GAIN and self._is_clear(k)]
        chosen = max([self._grown([]), *map(self._grown, seeds)], key=self._utility)
        for _ in range(_MAX_EXCHANGE_ROUNDS):
            if not self._exchange(chosen):
                break
        self._make_testable(chosen)
        return self._ordered([self._parts[k] for k in chosen])

    def assemble(self, chosen: Sequence[Part]) -> tuple[list[Segment],
                                                        list[tuple[float, float]]]:
        """Return the motion from start to start, and the start and end time of each part."""
        motion: list[Segment] = []
        times = []
        at, time = self._space.start, 0.0
        for part in chosen:
            segments = travel(self._space, at, part.base, self._limits) or []
            time += sum(segment.duration for segment in segments)
            times.append((time, time + part.duration))
            motion += [*segments, *part.segments]
            time += part.duration
            at = part.base
        return [*motion, *(travel(self._space, at, self._space.start, self._limits) or [])], times

    def informs(self, part: Part) -> list[int]:
        """Return the numbers of the questions about which a part alone gives information."""
        number = next(k for k, p in enumerate(self._parts) if p is part)
        gains = self._gains_alone[number]
        return [k for k, gain in enumerate(gains)
                if gain > max(_MIN_GAIN, _MIN_GAIN_SHARE * gains.max())]

    @cached_property
    def _gains_alone(self) -> FloatArray:
        """Return the gain of each part by itself, by question (C, Q)."""
        recorded = self._criterion.sums.recorded
        after = np.concatenate([self._criterion.utilities(recorded + self._added[k:k + 64])
                                for k in range(0, len(self._added), 64)])
        return np.asarray(after - self._criterion.utilities(recorded[None]))

    @cached_property
    def _alone(self) -> FloatArray:
        return np.asarray(self._gains_alone.sum(axis=1))

    def _sums(self, chosen: Sequence[int]) -> FloatArray:
        """Return the sums (L, L) of the recordings and of chosen parts."""
        return np.asarray(sum((self._added[k] for k in chosen), self._criterion.sums.recorded))

    def _utility(self, chosen: Sequence[int]) -> float:
        return float(self._criterion.utilities(self._sums(chosen)[None]).sum())

    def _gains(self, chosen: Sequence[int], more: Sequence[int]) -> FloatArray:
        """Return the gains (C,) of parts in addition to chosen ones."""
        after = self._criterion.utilities(self._sums(chosen) + self._added[list(more)])
        return np.asarray(after.sum(axis=1) - self._utility(chosen))

    def _grown(self, chosen: list[int]) -> list[int]:
        """Return a selection with parts added until none has a gain."""
        chosen, bounds = list(chosen), self._alone.copy()
        while (best := self._best_addition(chosen, bounds)) is not None:
            chosen.append(best)
        return chosen

    def _best_addition(self, chosen: list[int], bounds: FloatArray) -> int | None:
        """
        Return the part of largest gain per time, None if there is none.

        `bounds` (C,) are the last known gains. A gain rarely rises while parts are added, so only
        the parts whose rate by the bound exceeds the best rate are scored again.
        """
        used = self._time_of(chosen)
        times = {k: max(self._time_of([*chosen, k]) - used, _MIN_TIME) for k in self._free(chosen)}
        order = sorted((k for k, time in times.items() if used + time <= self._duration
                        or self._time_of([*chosen, k]) <= self._duration),
                       key=lambda k: -bounds[k] / times[k])
        best, rate = None, 0.0
        for start in range(0, len(order), _TOGETHER):
            group = order[start:start + _TOGETHER]
            if best is not None and bounds[group[0]] / times[group[0]] <= rate:
                break
            bounds[group] = self._gains(chosen, group)
            for k in group:
                if (bounds[k] > _MIN_GAIN and bounds[k] / times[k] > rate and self._is_clear(k)):
                    best, rate = k, bounds[k] / times[k]
        return best

    def _exchange(self, chosen: list[int]) -> bool:
        """Exchange parts in place where that has a gain; return whether any was exchanged."""
        improved = False
        for place in range(len(chosen)):
            rest = [*chosen[:place], *chosen[place + 1:]]
            # The travel between parts depends on their order.
            fits = [k for k in np.argsort(-self._alone).tolist() if k in self._free(rest)
                    and self._time_of([*chosen[:place], k, *chosen[place + 1:]])
                    <= self._duration][:_TRIED]
            gains = dict(zip(fits, self._gains(rest, fits))) if fits else {}
            own = float(self._gains(rest, [chosen[place]])[0])
            best = next((k for k in sorted(gains, key=lambda k: -gains[k])
                         if self._is_clear(k)), None)
            if best is not None and gains[best] > own + _MIN_GAIN:
                chosen[place], improved = best, True
        return improved

    def _free(self, chosen: Sequence[int]) -> list[int]:
        return [k for k in range(len(self._parts)) if k not in chosen and k not in self._colliding]

    def _is_clear(self, k: int) -> bool:
        """Return whether a part is free of collisions; a colliding one is excluded."""
        _, (path, _, _) = sampled(self._parts[k].segments, self._criterion.sums.planned.rate)
        if self._space.is_clear(path):
            return True
        self._colliding.add(k)
        return False

    def _make_testable(self, chosen: list[int]) -> None:
        """Add or exchange parts until every target that some part can show is testable."""
        open_now = self._n_untestable(chosen)
        for k in np.argsort(-self._alone).tolist()[:_TRIED]:
            if not chosen or not open_now:
                return
            if (k in chosen or not self._is_clear(k)
                    or self._n_untestable([*chosen, k]) >= open_now):
                continue
            trials = [[*chosen, k], *([*chosen[:n], k, *chosen[n + 1:]]
                                      for n in range(len(chosen)))]
            trials = [trial for trial in trials if self._time_of(trial) <= self._duration
                      and self._n_untestable(trial) < open_now]
            if trials:
                chosen[:] = trials[int(np.argmax([self._utility(trial) for trial in trials]))]
                open_now = self._n_untestable(chosen)

    def _n_untestable(self, chosen: Sequence[int]) -> int:
        """Return the number of targets that are untestable with a selection."""
        path = [segment for k in chosen for segment in self._parts[k].segments]
        if not path:
            return 0
        after = self._sums(chosen)
        return sum(bool(reason) for reason in untestable(self._criterion, path, after))

    def _ordered(self, parts: list[Part]) -> list[Part]:
        """Return parts grouped by joint and posture, unless that takes too long."""
        ordered = sorted(parts, key=lambda p: (p.joints, tuple(np.round(p.base, 6))))
        return ordered if self._time(ordered) <= self._duration else parts

    def _time_of(self, chosen: Sequence[int]) -> float:
        return self._time([self._parts[k] for k in chosen])

    def _time(self, parts: Sequence[Part]) -> float:
        time, at = 0.0, self._space.start
        for base, length in [*((p.base, p.duration) for p in parts), (self._space.start, 0.0)]:
            time += self._travel_time(at, base) + length
            at = base
        return time

    def _travel_time(self, a: FloatArray, b: FloatArray) -> float:
        key = a.tobytes() + b.tobytes()
        if key not in self._travel_times:
            segments = travel(self._space, a, b, self._limits)
            self._travel_times[key] = float('inf') if segments is None else sum(
                segment.duration for segment in segments)
        return self._travel_times[key]


def untestable(criterion: Criterion, path: Sequence[Segment], after: FloatArray) -> list[str]:
    """
    Return for each question why recordings and path do not identify it, '' if they do.

    :param after: the sums (L, L) of both.
    """
    sums, reasons = criterion.sums, []
    limit = sums.planned.regression.problem.options.min_identified
    both = sums.planned.joined(path) if criterion.questions else None
    for question in criterion.questions:
        assert both is not None
        term = question.term
        reason = term.effect.untestable(both, term.joint_number) or ''
        share = identified(sums, question, after)
        if not reason and share < limit:
            reason = f'the other terms absorb all but {share:.1%} of its torque'
        reasons.append(reason)
    return reasons
