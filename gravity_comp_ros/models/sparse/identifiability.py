"""
Identifiable features of a motion.

The sin and cos columns of a joint at rest are collinear with the constant. The features that
contain them are dropped and reported, so that the solver does not distribute a weight among them.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.models.sparse import dictionary
import numpy as np

# Maximum joint travel, in rad, of a joint that counts as at rest (encoder noise, control jitter).
_AT_REST = 2e-3


def at_rest(q: FloatArray) -> BoolArray:
    """Return the mask (N,) of the joints of q (M, N) in rad that are at rest."""
    return np.ptp(q, axis=0) < _AT_REST if len(q) else np.ones(q.shape[1], dtype=bool)


def usable_for_torque(q: FloatArray) -> BoolArray:
    """Return the mask of features without sin and cos of joints at rest, shape (3^N,)."""
    return _mask(q.shape[1], {n: {dictionary.ONE} for n in np.flatnonzero(at_rest(q))})


def usable_for_energy(q: FloatArray) -> BoolArray:
    """
    Return the mask of features with an identifiable gradient, shape (3^N,).

    A joint at rest keeps the constant and the factor with the larger derivative at its position,
    which determines its own torque.
    """
    kept = {}
    for n in np.flatnonzero(at_rest(q)):
        position = float(q[:, n].mean())
        steeper = (dictionary.SIN if abs(np.cos(position)) >= abs(np.sin(position))
                   else dictionary.COS)
        kept[n] = {dictionary.ONE, steeper}
    return _mask(q.shape[1], kept)


def _mask(n_joints: int, kept: dict) -> BoolArray:
    mask = np.ones((3,) * n_joints, dtype=bool)
    for joint, factors in kept.items():
        for factor in {dictionary.ONE, dictionary.SIN, dictionary.COS} - factors:
            mask[(slice(None),) * int(joint) + (factor,)] = False
    return mask.ravel()
