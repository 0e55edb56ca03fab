"""The chain's energy as a sum over the dictionary (Yu 2022, Property 1)."""

from __future__ import annotations

from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.dictionary import Expansion
import numpy as np

# Weights below this share of the largest are dropped: axes are estimated to 1e-5 rad at best.
_NEGLIGIBLE = 1e-7


def expand(chain: Chain) -> Expansion:
    """
    Return U in J as a sparse sum over the dictionary.

    The vertical w_i is a sum over products of the factors of the first i joints. Each joint
    multiplies it by Rz.T A.T, which has one part for each factor 1, sin and cos.
    """
    vertical = np.array([[0.0, 0.0, 1.0]])
    energy = np.zeros(1)
    for axis, moment in zip(chain.axes, chain.moments):
        before = vertical @ axis
        x, y, z = before.T
        zero = np.zeros_like(x)
        parts = np.empty((len(before), 3, 3))
        parts[:, dictionary.ONE] = np.stack([zero, zero, z], axis=1)
        parts[:, dictionary.SIN] = np.stack([y, -x, zero], axis=1)
        parts[:, dictionary.COS] = np.stack([x, y, zero], axis=1)
        vertical = parts.reshape(-1, 3)
        grown = parts[:, :, :2] @ moment
        grown[:, dictionary.ONE] += energy
        energy = grown.ravel()
    energy[0] = 0.0  # a constant has no torque
    kept = np.flatnonzero(np.abs(energy) > _NEGLIGIBLE * np.abs(energy).max(initial=0.0))
    return Expansion(kept, energy[kept])
