"""What a payload can be, and what a window of samples shows of one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.kinematic.geometry import STANDARD_GRAVITY
import numpy as np

# Parts that a window is divided into: what changed must show in each of them.
PARTS = 3


@dataclass(frozen=True)
class PayloadLimits:
    """
    What a payload can be: up to `mass` kg put on or taken off, `reach` m away.

    Without known axes `reach` bounds the distance between two neighbouring joints as well.

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
    What a window of samples shows.

    `is_payload` says that a body on the last link explains it, `is_other` that the effort has
    changed as no payload changes it. `text` is a sentence, `values` are figures with their names.
    """

    is_payload: bool
    is_other: bool
    text: str
    values: Mapping[str, str] = field(default_factory=dict)
