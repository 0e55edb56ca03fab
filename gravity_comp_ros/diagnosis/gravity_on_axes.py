"""
The gravity of an arm whose axes a description gives: moments by least squares, and the base.

Whether the base stands as described is asked anew. A fit of gravity to fast motion can take
inertia for a small tilt, and a tilt that a model has by mistake would be found again as an effect.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion_fit import independent
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics, tilt
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np

# Directions that the motion excites less, next to the most excited, are left out.
_EXCITED = 1e-3
# A joint that carries nothing has no more weight than one with this share of the largest torque:
# its directions would be the only ones that count as excited.
_LEAST = 1e-2
# A tilt must make the data this much likelier than none (natural logarithm), beside what two more
# numbers gain by chance.
_LIKELIER = 6.0
_STEPS, _SMALL = 6, 1e-5


def chain_on_axes(rotations: FloatArray, samples: JointSamples) -> Chain:
    """
    Return the serial arm on axes (N, 3, 3) that fits the torque best.

    Its base is tilted where the data ask for it.
    """
    q, tau = samples.q, samples.tau
    spread = tau.std(axis=0)
    weight = 1.0 / np.maximum(spread, max(_LEAST * float(spread.max()), 1e-9))
    level = _moments(rotations, q, tau, weight)
    tilted = level
    for _ in range(_STEPS):
        turned = _tilted(tilted, _step(tilted, q, tau, weight))
        tilted = _moments(turned.axes, q, tau, weight)
    before, after = (float(((tau - chain.torque(q)) ** 2 * weight ** 2).sum())
                     for chain in (level, tilted))
    gained = 0.5 * independent(samples) * np.log(max(before, 1e-300) / max(after, 1e-300))
    return tilted if gained > _LIKELIER else level


def columns_on_axes(chain: Chain, q: FloatArray) -> FloatArray:
    """Return how the torque at q (M, N) changes with tilt and moments, (M, N, 2 + 2 N)."""
    now = chain.torque(q)
    turned = [(_tilted(chain, _SMALL * unit).torque(q) - now) / _SMALL for unit in np.eye(2)]
    moments = ForwardKinematics(chain.axes, q).moment_columns().transpose(2, 1, 0)
    return np.concatenate([np.stack(turned, axis=2), moments], axis=2)


def _moments(rotations: FloatArray, q: FloatArray, tau: FloatArray,
             weight: FloatArray) -> Chain:
    columns = ForwardKinematics(rotations, q).moment_columns()
    flat = (columns * weight[None, :, None]).reshape(len(columns), -1).T
    found = lstsq(flat, (tau * weight).T.ravel(), rcond=_EXCITED)
    return Chain(rotations, np.asarray(found.reshape(-1, 2), dtype=float))


def _step(chain: Chain, q: FloatArray, tau: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the two angles (2,) in rad by which the base turns in a step of Gauss and Newton."""
    flat = (columns_on_axes(chain, q) * weight[None, :, None]).reshape(tau.size, -1)
    left = ((tau - chain.torque(q)) * weight).ravel()
    return np.asarray(lstsq(flat, left, rcond=_EXCITED)[:2])


def _tilted(chain: Chain, angles: FloatArray) -> Chain:
    """Return the arm with its base turned about the horizontal axes."""
    axes = chain.axes.copy()
    axes[0] = tilt(np.clip(angles, -0.5, 0.5)[None])[0] @ axes[0]
    return Chain(axes, chain.moments)
