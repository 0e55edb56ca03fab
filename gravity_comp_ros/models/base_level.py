"""
Level bases, and models without features of the first joint.

Gravity has no torque about a vertical first axis, so the model of a level arm needs no features of
its first joint. A small tilt of the base is then an effect (`base_tilt`).
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.expansion import Expansion
import numpy as np

# Maximum torque of the first joint, as a share of the largest, on a base that is level up to a
# small tilt. More indicates a wall or an incline, which the gravity model must include.
_NEARLY_LEVEL = 0.15


def is_level(torque: FloatArray) -> bool:
    """Return whether torques (M, N) in N·m indicate a nearly level base."""
    rms = np.sqrt((torque ** 2).mean(axis=0))
    return bool(rms[0] <= _NEARLY_LEVEL * rms.max())


def levelled(model: GravityModel, q: FloatArray) -> GravityModel:
    """Return the model without features of the first joint, if they are small."""
    energy, n = model.energy, model.n_joints
    if energy is None or n < 2 or model.chain is not None:
        return model
    first = dictionary.digits(energy.indices, n)[:, 0] != dictionary.ONE
    if not first.any() or not is_level(model.predict(q)):
        return model
    kept = Expansion(energy.indices[~first], energy.weights[~first])
    level = GravityModel.from_energy(model.joints, model.formulation, kept, model.noise,
                                     model.coverage, model.provenance)
    return replace(level, applied=model.applied, history=model.history, geometry=model.geometry)
