"""Limits of a payload."""

from __future__ import annotations

from dataclasses import dataclass

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
