"""
Which features a motion can tell apart.

A joint that never moves makes its sin and cos columns copies of the constant: the features that
hold them are dropped, and the user is told, rather than let a solver share a weight among them.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.models.sparse import dictionary
import numpy as np

# A joint that moves less than this is at rest: encoder noise and a controller's jitter.
AT_REST = 2e-3


def at_rest(q: FloatArray) -> BoolArray:
    """Return which joints of q (M, N) in rad never move, shape (N,)."""
    return np.ptp(q, axis=0) < AT_REST if len(q) else np.ones(q.shape[1], dtype=bool)


def usable_for_torque(q: FloatArray) -> BoolArray:
    """Return the mask of features without sin and cos of joints at rest, shape (3^N,)."""
    return _mask(q.shape[1], {n: {dictionary.ONE} for n in np.flatnonzero(at_rest(q))})


def usable_for_energy(q: FloatArray) -> BoolArray:
    """
    Return the mask of features whose gradient the motion can tell apart, shape (3^N,).

    A joint at rest keeps, beside the constant, the one of its two factors whose derivative is
    not near 0 there: that is what its own torque is made of.
    """
    kept = {}
    for n in np.flatnonzero(at_rest(q)):
        here = float(q[:, n].mean())
        steeper = dictionary.SIN if abs(np.cos(here)) >= abs(np.sin(here)) else dictionary.COS
        kept[n] = {dictionary.ONE, steeper}
    return _mask(q.shape[1], kept)


def _mask(n_joints: int, kept: dict) -> BoolArray:
    mask = np.ones((3,) * n_joints, dtype=bool)
    for joint, factors in kept.items():
        for factor in {dictionary.ONE, dictionary.SIN, dictionary.COS} - factors:
            mask[(slice(None),) * int(joint) + (factor,)] = False
    return mask.ravel()
