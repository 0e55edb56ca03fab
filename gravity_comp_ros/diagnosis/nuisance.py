"""What every joint may have beside gravity, and what must not be taken for anything rarer."""

from __future__ import annotations

from gravity_comp_ros.effects.effect import Motion
from gravity_comp_ros.samples import FloatArray
import numpy as np


def nuisance(motion: Motion, joint: int) -> FloatArray:
    """Return the columns (M, 4) of dry and viscous friction, own inertia and an offset."""
    qd, qdd = motion.samples.qd[:, joint], motion.qdd[:, joint]
    return np.column_stack([motion.direction(joint), qd, qdd, np.ones(len(qd))])
