"""A check of effects against physics: none makes more torque than there is."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# An effect that alone makes more than this many times the largest torque measured is two
# effects that cancel.
_TOO_MUCH = 1.5


def too_much_torque(torque: FloatArray, motion: Motion, joint: int) -> str | None:
    """Return an objection if a torque (M,) of the joint, or (M, N), exceeds what was measured."""
    measured = np.abs(motion.samples.tau)
    if torque.ndim == 1:
        measured = measured[:, joint]
    peak = float(np.abs(torque).max(initial=0.0))
    limit = float(measured.max(initial=0.0))
    if peak > _TOO_MUCH * limit:
        return f'it would make up to {peak:.3g} N·m where at most {limit:.3g} N·m were measured'
    return None
