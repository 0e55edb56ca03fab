"""The parts that give most information for their time: greedily chosen, then exchanged."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.planning.candidates import Part, travel
from gravity_comp_ros.planning.inquiry import Inquiry, Valued
from gravity_comp_ros.planning.regressors import Situation
from gravity_comp_ros.planning.segments import Pace, sampled, Segment
from gravity_comp_ros.planning.workspace import Workspace
import numpy as np

_EXCHANGES = 2
# Parts that a choice is grown from, and where the best choice hides a target.
_SEEDS = 3
# Less than this is no help, in the units of `Answer.value`.
_HELPS = 0.02
# What a companion counts beside a target.
_BESIDE = 0.5


class Chooser:
    """Chooses among parts by the information that each adds to that of the recordings."""

    def __init__(self, space: Workspace, situation: Situation,
                 inquiries: tuple[Sequence[Inquiry], Sequence[Inquiry]],
                 parts: Sequence[Part], pace: Pace, duration: float) -> None:
        """
        Measure the information of every part.

        :param inquiries: the targets', and those of companions, which count less.
        """
        self._space, self._situation, self._pace = space, situation, pace
        self._n_targets, self._duration = len(inquiries[0]), duration
        self._inquiries = [*inquiries[0], *inquiries[1]]
        self._weights = [1.0] * len(inquiries[0]) + [_BESIDE] * len(inquiries[1])
        self._travel_times: dict[bytes, float] = {}
        self._blocked: set[int] = set()
        self._gradient = any(inquiry.uses_gradient for inquiry in self._inquiries)
        self._parts = [part for part in parts if self._time([part]) <= duration]
        self._old = [inquiry.recorded() for inquiry in self._inquiries]
        self._new = [self._of_part(part) for part in self._parts]

    def choose(self) -> list[Part]:
        """
        Return the parts in the order in which they are played.

        None comes twice: noise would average out, but what the model lacks there would not.
        """
        chosen = max([self._grown([]), *map(self._grown, self._best_alone())], key=self._value)
        for _ in range(_EXCHANGES):
            if not self._exchange(chosen):
                break
        self._make_testable(chosen)
        hidden = self._hidden(chosen)
        if hidden:
            chosen = self._grown_testable(chosen, hidden)
        return self._ordered([self._parts[k] for k in chosen])

    def assemble(self, chosen: Sequence[Part]) -> tuple[list[Segment],
                                                        list[tuple[float, float]]]:
        """Return the whole motion from start to start, and when each part begins and ends."""
        motion: list[Segment] = []
        stretches = []
        at, time = self._space.start, 0.0
        for part in chosen:
            way = self._way(at, part.base)
            motion += way
            time += sum(segment.duration for segment in way)
            stretches.append((time, time + part.duration))
            motion += part.segments
            time += part.duration
            at = part.base
        motion += self._way(at, self._space.start)
        return motion, stretches

    def answers_before(self) -> list[Valued]:
        """Return what the recordings alone say of the targets."""
        return self._answers(self._old)[:self._n_targets]

    def answers_after(self, motion: Sequence[Segment]) -> list[Valued]:
        """Return what the recordings and a whole motion say of the targets."""
        return self._answers([old + new for old, new in zip(
            self._old, self._information(tuple(motion)))])[:self._n_targets]

    def untestable(self, both: Motion) -> list[str | None]:
        """Return by target why a diagnosis of recordings and motion will not look for it."""
        return [inquiry.untestable(both) for inquiry in self._inquiries[:self._n_targets]]

    def joined(self, motion: Sequence[Segment]) -> Motion:
        """Return recordings and a planned motion as a diagnosis of both will see them."""
        return self._situation.joined(motion)

    def helps(self, part: Part) -> list[int]:
        """Return the questions that a part by itself helps to settle."""
        new = self._new[next(k for k, p in enumerate(self._parts) if p is part)]
        gains = [0.0 if b is None else inquiry.answer(a + b).value - inquiry.answer(a).value
                 for inquiry, a, b in zip(self._inquiries[:self._n_targets], self._old, new)]
        return [k for k, gain in enumerate(gains) if gain > max(_HELPS, 0.3 * max(gains))]

    @cached_property
    def _alone(self) -> list[float]:
        """Return what each part by itself adds to the value of the recordings."""
        values = self._values(self._old)
        return [self._gain(self._old, values, k) for k in range(len(self._parts))]

    def _best_alone(self) -> list[list[int]]:
        """Return the parts that tell most, each by itself: a long one never comes by its rate."""
        return [[k] for k in np.argsort(self._alone)[::-1][:_SEEDS].tolist()
                if self._alone[k] > _HELPS and self._is_clear(k)]

    def _grown(self, chosen: list[int], most_hidden: int | None = None) -> list[int]:
        """Return parts with others added as long as one helps and none hides a target."""
        chosen = list(chosen)
        while (best := self._best_addition(chosen, most_hidden)) is not None:
            chosen.append(best)
        return chosen

    def _grown_testable(self, chosen: list[int], hidden: int) -> list[int]:
        """
        Return parts that are grown from one that shows more targets, if there is one.

        Parts at one posture can hide what others show: the ends of a joint's travel are then seen
        in that posture alone.
        """
        order = sorted(range(len(self._parts)), key=lambda k: -self._alone[k])
        showing = [k for k in order if self._hidden([k]) < hidden and self._is_clear(k)]
        trials = [self._grown([k], self._hidden([k])) for k in showing[:_SEEDS]]
        return max(trials, key=self._value, default=chosen)

    def _best_addition(self, chosen: list[int], most_hidden: int | None) -> int | None:
        used, known = self._time_of(chosen), self._total(chosen)
        values, gains = self._values(known), {}
        for k in self._free(chosen):
            time = self._time_of([*chosen, k])
            if time <= self._duration and (gain := self._gain(known, values, k)) > _HELPS:
                gains[k] = gain / max(time - used, 0.5)
        return next((k for k in sorted(gains, key=lambda k: -gains[k]) if self._is_clear(k)
                     and (most_hidden is None or self._hidden([*chosen, k]) <= most_hidden)), None)

    def _exchange(self, chosen: list[int]) -> bool:
        """Replace parts by others of the same time or less where that tells more."""
        improved = False
        for place in range(len(chosen)):
            rest = [*chosen[:place], *chosen[place + 1:]]
            known = self._total(rest)
            values = self._values(known)
            best, most = chosen[place], self._gain(known, values, chosen[place])
            for k in self._free(rest):
                # Ways between parts depend on their order.
                if self._time_of([*chosen[:place], k, *chosen[place + 1:]]) > self._duration:
                    continue
                gain = self._gain(known, values, k)
                if gain > most + _HELPS and self._is_clear(k):
                    best, most = k, gain
            if best != chosen[place]:
                chosen[place], improved = best, True
        return improved

    def _free(self, chosen: Sequence[int]) -> list[int]:
        """Return the parts that may be added."""
        return [k for k in range(len(self._parts)) if k not in chosen and k not in self._blocked]

    def _is_clear(self, k: int) -> bool:
        """Return whether a part hits nothing; one that does is not looked at again."""
        _, (path, _, _) = sampled(self._parts[k].segments, self._situation.rate)
        if self._space.is_clear(path):
            return True
        self._blocked.add(k)
        return False

    def _make_testable(self, chosen: list[int]) -> None:
        """Exchange parts until a diagnosis will look for every target that some part shows."""
        hidden = self._hidden(chosen)
        if not chosen or not hidden:
            return
        for k in np.argsort(self._alone)[::-1].tolist():
            if not hidden:
                return
            if k in chosen or self._hidden([*chosen, k]) >= hidden or not self._is_clear(k):
                continue
            trials = [[*chosen, k]] + [[*chosen[:n], k, *chosen[n + 1:]]
                                       for n in range(len(chosen))]
            trials = [each for each in trials
                      if self._time_of(each) <= self._duration
                      and self._hidden(each) < hidden]
            if trials:
                chosen[:] = trials[int(np.argmax([self._value(each) for each in trials]))]
                hidden = self._hidden(chosen)

    def _hidden(self, chosen: Sequence[int]) -> int:
        """Return how many targets are untestable after some parts."""
        motion = [segment for k in chosen for segment in self._parts[k].segments]
        return sum(reason is not None for reason in self.untestable(self.joined(motion))) \
            if motion else 0

    def _ordered(self, parts: list[Part]) -> list[Part]:
        """Return parts so that those of one joint and one posture follow each other."""
        ordered = sorted(parts, key=lambda p: (p.joints, tuple(np.round(p.base, 6))))
        # Ordering must not make the ways longer than they were.
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
            way = travel(self._space, a, b, self._pace)
            self._travel_times[key] = float('inf') if way is None else sum(
                segment.duration for segment in way)
        return self._travel_times[key]

    def _way(self, a: FloatArray, b: FloatArray) -> list[Segment]:
        # `_time` of the same parts was finite, so that there is a way.
        return travel(self._space, a, b, self._pace) or []

    def _information(self, segments: Sequence[Segment]) -> list[FloatArray]:
        motion = self._situation.planned(tuple(segments), self._gradient)
        return [inquiry.planned(motion) for inquiry in self._inquiries]

    def _of_part(self, part: Part) -> list[FloatArray | None]:
        """Return the information of a part; None of an effect whose joint it does not move."""
        concerned = [inquiry.joint is None or inquiry.joint in part.joints
                     for inquiry in self._inquiries]
        motion = self._situation.planned(part.segments, self._gradient)
        return [inquiry.planned(motion) if here else None
                for inquiry, here in zip(self._inquiries, concerned)]

    def _total(self, chosen: Sequence[int]) -> list[FloatArray]:
        total = list(self._old)
        for k in chosen:
            total = [a if b is None else a + b for a, b in zip(total, self._new[k])]
        return total

    def _answers(self, information: Sequence[FloatArray]) -> list[Valued]:
        return [inquiry.answer(each) for inquiry, each in zip(self._inquiries, information)]

    def _values(self, information: Sequence[FloatArray]) -> list[float]:
        return [each.value for each in self._answers(information)]

    def _gain(self, known: Sequence[FloatArray], values: Sequence[float], k: int) -> float:
        """Return what a part adds to the value of what is known."""
        return sum(weight * (inquiry.answer(a + b).value - value) for weight, inquiry, a, b, value
                   in zip(self._weights, self._inquiries, known, self._new[k], values)
                   if b is not None)

    def _value(self, chosen: Sequence[int]) -> float:
        """Return what some parts are worth, recordings included."""
        return float(np.dot(self._weights, self._values(self._total(chosen))))
