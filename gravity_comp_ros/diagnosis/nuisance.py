"""What every joint may have beside gravity, and what must not be taken for anything rarer."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_fit import friction
import numpy as np


def nuisance(motion: Motion, joint: int) -> FloatArray:
    """Return the columns (M, 3 + N) of dry and viscous friction, an offset and inertia."""
    return np.column_stack([friction(motion, joint), motion.qdd])
