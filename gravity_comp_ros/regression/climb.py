"""Climb from a nonlinear setting to the best one near it, in steps that are halved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

# Gain in nats for which a setting is changed.
BETTER = 0.01

Point = TypeVar('Point')


def climbed(start: Point, gain: float,
            near: Callable[[Point, float], Sequence[tuple[float, Point]]], halvings: int,
            needed: float = -float('inf')
            ) -> tuple[float, Point, Sequence[tuple[float, Point]]]:
    """
    Return the gain and the place of the maximum near a start, and its neighbours at the last step.

    Let d be the sum of the differences between the best point and its two neighbours along a
    parameter. A parabola through the three has a maximum that is at most d / 8 above the best
    point. The climb ends where the sum of these bounds over all parameters is negligible.

    :param gain: that of the start, in nats.
    :param near: returns the neighbours of a point at a step, with their gains; the first step is
        1.
    :param needed: the least gain of interest. Finer steps gain less than the last two, so that it
        ends as well where these would not suffice.
    """
    best, reached = start, [gain]
    for number in range(halvings):
        while tried := near(best, 0.5 ** number):
            value, point = max(tried, key=lambda each: each[0])
            if value <= gain + BETTER:
                break
            gain, best = value, point
        higher = sum(gain - value for value, _ in tried) / 8.0
        reached.append(gain)
        if higher < BETTER or (number and 2.0 * gain - reached[-3] < needed):
            break
    return gain, best, tried
