"""Limits of a payload, and the finding of a payload test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.kinematic.geometry import STANDARD_GRAVITY
import numpy as np

# Number of parts of a window; a change must be present in each of them.
PARTS = 3


@dataclass(frozen=True)
class PayloadLimits:
    """
    Limits of a payload: up to `mass` kg attached or removed, at most `reach` m away.

    Without known axes `reach` also bounds the distance between neighbouring joints.

    :raises OptionError: if a number is not positive.
    """

    mass: float = 20.0
    reach: float = 1.0

    def __post_init__(self) -> None:
        if not (0.0 < self.mass < np.inf and 0.0 < self.reach < np.inf):
            raise OptionError('payload limits: mass and reach must be positive')

    @property
    def moment(self) -> float:
        """The largest change of one link's moment, N·m."""
        return STANDARD_GRAVITY * self.mass * self.reach


@dataclass(frozen=True)
class PayloadFinding:
    """
    The finding of a payload test on a window of samples.

    `is_payload` is true if a body on the last link explains the window, `is_other` if the effort
    has changed in a way that no payload explains. `text` is a sentence, `values` are named
    figures.
    """

    is_payload: bool
    is_other: bool
    text: str
    values: Mapping[str, str] = field(default_factory=dict)
