"""Position limits of joints, from a robot description."""

from __future__ import annotations

from collections.abc import Sequence
import math

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.robot_tree import parse_tree
from gravity_comp_ros.errors import ModelMismatchError
import numpy as np


def position_limits(text: str | bytes, joints: Sequence[str],
                    source: str = 'URDF') -> tuple[FloatArray, FloatArray]:
    """
    Return the lower and upper limits (N,) in rad; a turn either way for a continuous joint.

    :raises DataError: if the text is no URDF.
    :raises ModelMismatchError: if a joint is not in it.
    """
    tree = parse_tree(text, source)
    missing = [name for name in joints if name not in tree.joints]
    if missing:
        raise ModelMismatchError(f'{source} has no joint {", ".join(missing)}')
    limits = [tree.joints[name].limits() or (-math.pi, math.pi) for name in joints]
    low, high = np.array(limits, dtype=np.float64).T
    return low, high
