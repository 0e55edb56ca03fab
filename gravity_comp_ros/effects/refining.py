"""Neighbours of a positive nonlinear parameter, to refine it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

# Factor of the first step from a value that is compared.
FACTOR = 1.5


def scaled(setting: Mapping[str, float], name: str, step: float, low: float = 0.0,
           high: float = np.inf) -> list[dict[str, float]]:
    """Return a setting with a smaller and a larger value of a parameter, between limits."""
    return [{**setting, name: float(np.clip(setting[name] * FACTOR ** change, low, high))}
            for change in (-step, step)]
