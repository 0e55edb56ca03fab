"""
Refinement of a nonlinear setting, and the Occam factor of the refined one.

From a setting that is compared the search climbs to the best one near it, in steps that are
halved. The evidence of a term is the mean over all settings that it may have, not that of the
best one. Those that are compared share the prior odds (`Term.log_odds`), and each represents a
cell of settings about it. In the cell the likelihood ratio falls as a normal distribution about a
best setting within, and as an exponential one from a best setting at a limit; its mean over the
cell is the factor (D. MacKay, Bayesian interpolation, Neural Computation 4, 1992).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

import numpy as np

Setting = Mapping[str, float]
# Part of its cell beyond which a neighbour is as far as the first ones: a parameter with separate
# values, such as a number of harmonics.
_NEAR = 0.4
# Smallest share of a cell.
_SMALLEST = 1e-9
# Gain in nats for which a setting is changed.
BETTER = 0.01

Point = TypeVar('Point')


def log_volume(best: Setting, cell: Iterable[Setting],
               near: Iterable[tuple[float, Setting]]) -> float:
    """
    Return the logarithm of the share of its cell in which a refined setting lies; 0 at most.

    :param cell: settings at the ends of the cell, of which each differs in one parameter.
    :param near: by how much the gain of neighbours is smaller, in nats, and their settings.
    """
    ends, falls = list(cell), list(near)
    return sum(_of_parameter(value, [end[name] for end in ends if name in end],
                             [(fall, other[name]) for fall, other in falls
                              if name in other and other[name] != value])
               for name, value in best.items())


def _of_parameter(value: float, ends: Sequence[float],
                  near: Sequence[tuple[float, float]]) -> float:
    """Return the logarithm of the share of one parameter."""
    if not near:
        return 0.0
    # Limits of a parameter may exclude the ends of its cell.
    fall = max(float(np.mean([each for each, _ in near])), 1e-9)
    distance = float(np.mean([abs(other - value) for _, other in near]))
    reached = [value, *ends, *(other for _, other in near)]
    size = max(reached) - min(reached)
    if distance > _NEAR * size:
        return 0.0
    width = distance / fall if len(near) == 1 else distance * np.sqrt(np.pi / fall)
    # A neighbour that the other terms explain has no gain at all.
    return min(0.0, float(np.log(max(width / size, _SMALLEST))))


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
