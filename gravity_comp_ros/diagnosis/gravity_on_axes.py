"""
Gravity of an arm with known joint axes: first moments by least squares, and base tilt.

The base tilt is estimated again. A fit of gravity to fast motion can absorb inertia in a small
tilt, and an erroneous tilt of the user's model would appear as an effect.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion_fit import effective_count
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics, tilt
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np

# Minimum singular value of an excited direction, relative to the largest.
_MIN_EXCITATION = 1e-3
# Minimum torque spread for the weight of a joint, relative to the largest spread. Otherwise only
# directions of joints without load would count as excited.
_MIN_SPREAD = 1e-2
# Log-likelihood ratio above which a tilt is accepted; two more parameters gain less by chance.
_LOG_LIKELIHOOD_RATIO = 6.0
# Gauss-Newton steps, and the angle in rad of finite differences.
_STEPS, _SMALL = 6, 1e-5


def chain_on_axes(rotations: FloatArray, samples: JointSamples) -> Chain:
    """Return the serial arm on axes (N, 3, 3) that fits best; tilted if that is significant."""
    q, tau = samples.q, samples.tau
    spread = tau.std(axis=0)
    weight = 1.0 / np.maximum(spread, max(_MIN_SPREAD * float(spread.max()), 1e-9))
    level = _moments(rotations, q, tau, weight)
    tilted = level
    for _ in range(_STEPS):
        rotated = _tilted(tilted, _step(tilted, q, tau, weight))
        tilted = _moments(rotated.axes, q, tau, weight)
    before, after = (float(((tau - chain.torque(q)) ** 2 * weight ** 2).sum())
                     for chain in (level, tilted))
    ratio = 0.5 * effective_count(samples) * np.log(max(before, 1e-300) / max(after, 1e-300))
    return tilted if ratio > _LOG_LIKELIHOOD_RATIO else level


def columns_on_axes(chain: Chain, q: FloatArray) -> FloatArray:
    """Return the derivatives of the torque at q (M, N) by tilt and moments, (M, N, 2 + 2 N)."""
    torque = chain.torque(q)
    by_tilt = [(_tilted(chain, _SMALL * unit).torque(q) - torque) / _SMALL for unit in np.eye(2)]
    moments = ForwardKinematics(chain.axes, q).moment_columns().transpose(2, 1, 0)
    return np.concatenate([np.stack(by_tilt, axis=2), moments], axis=2)


def _moments(rotations: FloatArray, q: FloatArray, tau: FloatArray,
             weight: FloatArray) -> Chain:
    columns = ForwardKinematics(rotations, q).moment_columns()
    flat = (columns * weight[None, :, None]).reshape(len(columns), -1).T
    moments = lstsq(flat, (tau * weight).T.ravel(), rcond=_MIN_EXCITATION)
    return Chain(rotations, np.asarray(moments.reshape(-1, 2), dtype=float))


def _step(chain: Chain, q: FloatArray, tau: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the tilt angles (2,) in rad of a Gauss-Newton step."""
    flat = (columns_on_axes(chain, q) * weight[None, :, None]).reshape(tau.size, -1)
    residual = ((tau - chain.torque(q)) * weight).ravel()
    return np.asarray(lstsq(flat, residual, rcond=_MIN_EXCITATION)[:2])


def _tilted(chain: Chain, angles: FloatArray) -> Chain:
    """Return the arm with its base rotated about the horizontal axes by angles (2,) in rad."""
    axes = chain.axes.copy()
    axes[0] = tilt(np.clip(angles, -0.5, 0.5)[None])[0] @ axes[0]
    return Chain(axes, chain.moments)
