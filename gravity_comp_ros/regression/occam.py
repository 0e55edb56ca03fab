"""
The Occam factor of a refined setting.

The evidence of a term is the mean over all settings that it may have, not that of the best one.
Those that are compared share the prior odds (`Term.log_odds`), and each represents a cell of
settings about it. In the cell the likelihood ratio falls as a normal distribution about a best
setting within, and as an exponential one from a best setting at a limit; its mean over the cell is
the factor (D. MacKay, Bayesian interpolation, Neural Computation 4, 1992).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

Setting = Mapping[str, float]
# Part of its cell beyond which a neighbour is as far as the first ones: a parameter with separate
# values, such as a number of harmonics.
_NEAR = 0.4
# Smallest share of a cell.
_SMALLEST = 1e-9


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
