"""Selection of candidate parts: greedy by information per time, then by exchange."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.planning.candidates import Part, travel
from gravity_comp_ros.planning.context import DesignContext
from gravity_comp_ros.planning.criterion import EffectScore
from gravity_comp_ros.planning.objectives import Objective, Score
from gravity_comp_ros.planning.segments import Limits, sampled, Segment
from gravity_comp_ros.planning.workspace import Workspace
import numpy as np

_MAX_EXCHANGE_ROUNDS = 2
# Number of parts from which a selection is grown.
_SEEDS = 3
# Smallest gain in utility that counts.
_MIN_GAIN = 0.02
# Weight of auxiliary objectives; that of targets is 1.
_AUXILIARY_WEIGHT = 0.5
# A part informs about a target if its gain is at least this share of its largest.
_MIN_GAIN_SHARE = 0.3
# A target with a smaller chance of a certain size counts as untestable.
_MIN_CHANCE_OF_SIZE = 0.9
# Shortest time by which a gain is divided, s.
_MIN_TIME = 0.5


class Selector:
    """Selects candidate parts by the utility of their information and that of the recordings."""

    def __init__(self, space: Workspace, context: DesignContext,
                 objectives: tuple[Sequence[Objective], Sequence[Objective]],
                 parts: Sequence[Part], limits: Limits, duration: float) -> None:
        """
        Compute the information of every candidate.

        :param objectives: those of targets, and auxiliary ones of less weight.
        """
        self._space, self._context, self._limits = space, context, limits
        self._n_targets, self._duration = len(objectives[0]), duration
        self._objectives = [*objectives[0], *objectives[1]]
        self._weights = [1.0] * len(objectives[0]) + [_AUXILIARY_WEIGHT] * len(objectives[1])
        self._travel_times: dict[bytes, float] = {}
        self._colliding: set[int] = set()
        self._gradient = any(objective.uses_gradient for objective in self._objectives)
        self._parts = [part for part in parts if self._time([part]) <= duration]
        self._recorded = [objective.recorded_information() for objective in self._objectives]
        self._of_parts = [self._part_information(part) for part in self._parts]

    def select(self) -> list[Part]:
        """
        Return the parts in the order in which they are played.

        No part comes twice: repetition averages noise, but not unmodelled torque at its poses.
        """
        chosen = max([self._grown([]), *map(self._grown, self._seeds())], key=self._utility)
        for _ in range(_MAX_EXCHANGE_ROUNDS):
            if not self._exchange(chosen):
                break
        self._make_testable(chosen)
        n_untestable = self._n_untestable(chosen)
        if n_untestable:
            chosen = self._grown_testable(chosen, n_untestable)
        return self._ordered([self._parts[k] for k in chosen])

    def assemble(self, chosen: Sequence[Part]) -> tuple[list[Segment],
                                                        list[tuple[float, float]]]:
        """Return the motion from start to start, and the start and end time of each part."""
        motion: list[Segment] = []
        times = []
        at, time = self._space.start, 0.0
        for part in chosen:
            segments = self._travel(at, part.base)
            time += sum(segment.duration for segment in segments)
            times.append((time, time + part.duration))
            motion += [*segments, *part.segments]
            time += part.duration
            at = part.base
        motion += self._travel(at, self._space.start)
        return motion, times

    def scores_before(self) -> list[Score]:
        """Return the scores of the targets with the recordings alone."""
        return self._scores(self._recorded)[:self._n_targets]

    def scores_after(self, motion: Sequence[Segment]) -> list[Score]:
        """Return the scores of the targets with the recordings and a whole motion."""
        planned = self._context.planned(motion, self._gradient)
        return self._scores([old + objective.planned_information(planned) for objective, old
                             in zip(self._objectives, self._recorded)])[:self._n_targets]

    def untestable(self, both: Motion) -> list[str | None]:
        """Return for each target why a diagnosis cannot test it, None if it can."""
        return [objective.untestable(both) for objective in self._objectives[:self._n_targets]]

    def informs(self, part: Part) -> list[int]:
        """Return the numbers of the targets about which a part by itself gives information."""
        new = self._of_parts[next(k for k, p in enumerate(self._parts) if p is part)]
        gains = [0.0 if b is None else objective.score(a + b).utility - objective.score(a).utility
                 for objective, a, b in zip(self._objectives[:self._n_targets], self._recorded,
                                            new)]
        return [k for k, gain in enumerate(gains)
                if gain > max(_MIN_GAIN, _MIN_GAIN_SHARE * max(gains))]

    @cached_property
    def _gains_alone(self) -> list[float]:
        """Return the gain of each part by itself over the recordings."""
        utilities = self._utilities(self._recorded)
        return [self._gain(self._recorded, utilities, k) for k in range(len(self._parts))]

    def _by_gain_alone(self) -> list[int]:
        return np.argsort(self._gains_alone)[::-1].tolist()

    def _seeds(self) -> list[list[int]]:
        """Return the parts of largest gain; growing by gain per time omits long ones."""
        return [[k] for k in self._by_gain_alone()[:_SEEDS]
                if self._gains_alone[k] > _MIN_GAIN and self._is_clear(k)]

    def _grown(self, chosen: list[int], max_untestable: int | None = None) -> list[int]:
        """Return a selection with parts added until none has a gain."""
        chosen = list(chosen)
        while (best := self._best_addition(chosen, max_untestable)) is not None:
            chosen.append(best)
        return chosen

    def _grown_testable(self, chosen: list[int], n_untestable: int) -> list[int]:
        """
        Return a selection grown from a part that makes more targets testable, if there is one.

        Parts at one posture can make a target of other parts untestable: the ends of a joint's
        travel are then visited in that posture only.
        """
        order = sorted(range(len(self._parts)), key=lambda k: -self._gains_alone[k])
        seeds = [k for k in order if self._n_untestable([k]) < n_untestable and self._is_clear(k)]
        trials = [self._grown([k], self._n_untestable([k])) for k in seeds[:_SEEDS]]
        return max(trials, key=self._utility, default=chosen)

    def _best_addition(self, chosen: list[int], max_untestable: int | None) -> int | None:
        """Return the part of largest gain per time, None if there is none."""
        used, known = self._time_of(chosen), self._total(chosen)
        utilities, rates = self._utilities(known), {}
        for k in self._free(chosen):
            time = self._time_of([*chosen, k])
            if time <= self._duration and (gain := self._gain(known, utilities, k)) > _MIN_GAIN:
                rates[k] = gain / max(time - used, _MIN_TIME)
        return next((k for k in sorted(rates, key=lambda k: -rates[k]) if self._is_clear(k)
                     and (max_untestable is None
                          or self._n_untestable([*chosen, k]) <= max_untestable)), None)

    def _exchange(self, chosen: list[int]) -> bool:
        """Exchange parts in place where that has a gain; return whether any was exchanged."""
        improved = False
        for place in range(len(chosen)):
            rest = [*chosen[:place], *chosen[place + 1:]]
            known = self._total(rest)
            utilities = self._utilities(known)
            best, largest = chosen[place], self._gain(known, utilities, chosen[place])
            for k in self._free(rest):
                # The travel between parts depends on their order.
                if self._time_of([*chosen[:place], k, *chosen[place + 1:]]) > self._duration:
                    continue
                gain = self._gain(known, utilities, k)
                if gain > largest + _MIN_GAIN and self._is_clear(k):
                    best, largest = k, gain
            if best != chosen[place]:
                chosen[place], improved = best, True
        return improved

    def _free(self, chosen: Sequence[int]) -> list[int]:
        return [k for k in range(len(self._parts)) if k not in chosen and k not in self._colliding]

    def _is_clear(self, k: int) -> bool:
        """Return whether a part is free of collisions; a colliding one is excluded."""
        _, (path, _, _) = sampled(self._parts[k].segments, self._context.rate)
        if self._space.is_clear(path):
            return True
        self._colliding.add(k)
        return False

    def _make_testable(self, chosen: list[int]) -> None:
        """Exchange parts in place until every target that some part can show is testable."""
        n_untestable = self._n_untestable(chosen)
        if not chosen or not n_untestable:
            return
        for k in self._by_gain_alone():
            if not n_untestable:
                return
            if (k in chosen or self._n_untestable([*chosen, k]) >= n_untestable
                    or not self._is_clear(k)):
                continue
            trials = [[*chosen, k]] + [[*chosen[:n], k, *chosen[n + 1:]]
                                       for n in range(len(chosen))]
            trials = [trial for trial in trials if self._time_of(trial) <= self._duration
                      and self._n_untestable(trial) < n_untestable]
            if trials:
                chosen[:] = trials[int(np.argmax([self._utility(trial) for trial in trials]))]
                n_untestable = self._n_untestable(chosen)

    def _n_untestable(self, chosen: Sequence[int]) -> int:
        """Return the number of targets that are untestable with a selection, or absorbed."""
        motion = [segment for k in chosen for segment in self._parts[k].segments]
        if not motion:
            return 0
        reasons = self.untestable(self._context.joined(motion))
        scores = self._scores(self._total(chosen))
        return sum(reason is not None or (isinstance(score, EffectScore) and
                                          score.chance_of_certain_size < _MIN_CHANCE_OF_SIZE)
                   for reason, score in zip(reasons, scores))

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

    def _travel(self, a: FloatArray, b: FloatArray) -> list[Segment]:
        # `_time` of the selected parts is finite, so the travel exists.
        return travel(self._space, a, b, self._limits) or []

    def _part_information(self, part: Part) -> list[FloatArray | None]:
        """Return the information of a part by objective; None if it does not move the joint."""
        motion = self._context.planned(part.segments, self._gradient)
        return [objective.planned_information(motion)
                if objective.joint is None or objective.joint in part.joints else None
                for objective in self._objectives]

    def _total(self, chosen: Sequence[int]) -> list[FloatArray]:
        """Return the information of the recordings and a selection."""
        total = list(self._recorded)
        for k in chosen:
            total = [a if b is None else a + b for a, b in zip(total, self._of_parts[k])]
        return total

    def _scores(self, information: Sequence[FloatArray]) -> list[Score]:
        return [objective.score(each) for objective, each in zip(self._objectives, information)]

    def _utilities(self, information: Sequence[FloatArray]) -> list[float]:
        return [score.utility for score in self._scores(information)]

    def _gain(self, known: Sequence[FloatArray], utilities: Sequence[float], k: int) -> float:
        """Return the increase of the weighted utility by a part."""
        return sum(weight * (objective.score(a + b).utility - utility)
                   for weight, objective, a, b, utility
                   in zip(self._weights, self._objectives, known, self._of_parts[k], utilities)
                   if b is not None)

    def _utility(self, chosen: Sequence[int]) -> float:
        """Return the weighted utility of the recordings and a selection."""
        return float(np.dot(self._weights, self._utilities(self._total(chosen))))
