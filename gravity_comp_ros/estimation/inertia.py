"""
Inertia as a nuisance term: which motion has it, and from which accelerations.

Fast or uneven motion has the whole mass matrix in its torque. In slow motion the inertia of the
joint itself counts: that of the first joint of an arm on a vertical axis, which has no gravity
torque, would otherwise appear as a tilt of the base.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
import numpy as np

# Motion is fast, with inertia in its torque, if some joint exceeds this speed (rad/s) for this
# share of the samples.
_FAST, _MIN_FAST_SHARE = 0.2, 0.1
# Slow motion has the whole mass matrix in its torque as well, if some joint exceeds this
# acceleration (rad/s^2) for this share of the samples.
_ACCELERATED, _MIN_ACCELERATED_SHARE = 0.3, 0.02
# Minimum RMS acceleration, in rad/s^2, of a joint whose inertia is a term of the other joints.
_MIN_ACCELERATION = 0.05


@dataclass(frozen=True, eq=False)
class Inertia:
    """
    Accelerations `qdd` (M, N) in rad/s^2 of inertia terms.

    With `is_coupled` the torque of a joint has a term for the acceleration of every joint that
    accelerates, otherwise for its own.
    """

    qdd: FloatArray
    is_coupled: bool

    def sources(self, joint: int) -> list[int]:
        """Return the joints whose acceleration has a term in the torque of a joint."""
        if not self.is_coupled:
            return [joint]
        rms = np.sqrt((self.qdd ** 2).mean(axis=0))
        return [int(n) for n in np.flatnonzero(rms > _MIN_ACCELERATION)]


def inertia_of(samples: JointSamples, qdd: FloatArray) -> Inertia:
    """
    Return the accelerations whose torque is inertia.

    Samples of quick starts and stops in slow motion get 0: their short accelerations cannot be
    measured, and a few such samples would determine the inertia.

    :param qdd: accelerations (M, N) in rad/s^2 of the samples.
    """
    if _excites_inertia(samples, qdd):
        return Inertia(qdd, True)
    quick = np.asarray((np.abs(qdd) > _ACCELERATED).any(axis=1))
    return Inertia(np.where(quick[:, None], 0.0, qdd), False)


def is_fast(samples: JointSamples) -> bool:
    """Return whether some joint is fast in at least a tenth of the samples."""
    return bool((np.abs(samples.qd) > _FAST).any(axis=1).mean() > _MIN_FAST_SHARE)


def _excites_inertia(samples: JointSamples, qdd: FloatArray) -> bool:
    """
    Return whether motion is fast, or slow with quick starts and stops.

    Without inertia a few poses with a quick approach would be outliers, although an axis may be
    identifiable only from them.
    """
    accelerated = (np.abs(qdd) > _ACCELERATED).any(axis=1)
    return is_fast(samples) or bool(accelerated.mean() > _MIN_ACCELERATED_SHARE)
