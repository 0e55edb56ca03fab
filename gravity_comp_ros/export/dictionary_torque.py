"""
The torque of an effect as a sum over the dictionary, if it is one.

A sum over products of one factor {1, sin q_n, cos q_n} per joint is determined by its values at
the 3^N poses whose angles are 0 and ±2 pi / 3: along each joint, three values give the three
weights. Other poses and speeds show whether the torque is such a sum.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Needs
from gravity_comp_ros.effects.predict import installed, torque_of
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.sparse.dictionary import Expansion, torque_of as sums_at
import numpy as np

# Number of joints up to which 3^N poses are evaluated at once.
_MAX_JOINTS = 9
# Weights below this share of the largest torque are rounding, and so are deviations.
_ROUNDING = 1e-10
_CHECKED = 64


def dictionary_torque(model: GravityModel, effect: AppliedEffect
                      ) -> tuple[Expansion, ...] | None:
    """Return one sum per joint in N·m; None if the torque of the effect is no such sum."""
    n = model.n_joints
    if n > _MAX_JOINTS:
        return None
    angles = np.array([0.0, 2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0])
    grid = np.stack(np.meshgrid(*n * [angles], indexing='ij'), axis=-1).reshape(-1, n)
    rng = np.random.default_rng(0)
    others, speeds = rng.uniform(-3.0, 3.0, (_CHECKED, n)), rng.normal(0.0, 1.0, (_CHECKED, n))
    try:
        if installed(effect).needs is not Needs.SPEED:
            return None
        at_grid = torque_of(model, [effect], _at(model, grid, 0.0 * grid))
        at_others = torque_of(model, [effect], _at(model, others, speeds))
    except GravityCompError:
        return None
    scale = float(np.abs(at_grid).max(initial=1e-9))
    torques = tuple(_sum(values, scale, n) for values in at_grid.T)
    deviation = np.abs(sums_at(torques, others) - at_others).max()
    return torques if deviation <= 1e3 * _ROUNDING * scale else None


def _at(model: GravityModel, q: FloatArray, qd: FloatArray) -> JointSamples:
    return JointSamples.single_run(model.joints, np.arange(len(q)), q, qd, np.zeros_like(q))


def _sum(values: FloatArray, scale: float, n: int) -> Expansion:
    """Return the sum with these values (3^N,) on the grid."""
    third, root = 1.0 / 3.0, 1.0 / np.sqrt(3.0)
    to_weights = np.array([[third, third, third], [0.0, root, -root],
                           [2.0 * third, -third, -third]])
    weights = values.reshape(n * (3,))
    for joint in range(n):
        weights = np.moveaxis(np.tensordot(to_weights, weights, axes=(1, joint)), 0, joint)
    flat = weights.ravel()
    kept = np.flatnonzero(np.abs(flat) > _ROUNDING * scale)
    return Expansion(kept, flat[kept])
