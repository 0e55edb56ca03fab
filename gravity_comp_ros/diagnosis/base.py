"""
The gravity model that effects are judged beside.

The base comes first: its support is chosen while friction, an offset and inertia are projected
out of the torque, so that it does not grow features to imitate them. A nearly level arm is given
no features of its first joint: gravity has none there, and what the first joint's angle does to
the torque (a tilted base) is then left for an effect to explain.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.effects.effect import Motion
from gravity_comp_ros.effects.motion import build_motion
from gravity_comp_ros.gravity import dictionary
from gravity_comp_ros.gravity.design import EnergyDesign
from gravity_comp_ros.gravity.fit import fit, FitOptions
from gravity_comp_ros.gravity.model import Expansion, GravityModel
from gravity_comp_ros.gravity.sparse import SparseOptions
from gravity_comp_ros.samples import FloatArray, IntArray, JointSamples
import numpy as np

_SAMPLES = 1500
# What is missing is still in the torque and correlated over seconds: a few samples count as one.
_CAUTIOUS = FitOptions(sparse=SparseOptions(inflation=4.0))
# An arm whose first joint carries less than this share of the largest torque is level but for
# a tilt; more is a wall or an incline, whose gravity the base must hold.
_NEARLY_LEVEL = 0.15


def choose_base(samples: JointSamples, model: GravityModel | None
                ) -> tuple[GravityModel, IntArray, Motion]:
    """
    Return the gravity model, the energy features to refit with effects, and the motion.

    :param model: the user's model if there is one, and if it has an energy; else one is fitted.
    """
    if model is None or model.energy is None:
        few = samples.select(np.arange(samples.n_samples)
                             % max(1, samples.n_samples // _SAMPLES) == 0)
        rough = fit(few, _CAUTIOUS).model
        motion = build_motion(samples, rough)
        cleaned = replace(samples, tau=samples.tau - _nuisance(motion, _features(rough)))
        kept = cleaned.select(np.arange(samples.n_samples)
                              % max(1, samples.n_samples // _SAMPLES) == 0)
        model = fit(kept, _CAUTIOUS).model
    model = _level(model, samples.q)
    return model, _features(model), build_motion(samples, model)


def _features(model: GravityModel) -> IntArray:
    return model.energy.indices if model.energy else np.zeros(0, dtype=np.int64)


def _nuisance(motion: Motion, features: IntArray) -> FloatArray:
    """Return the torque (M, N) that friction, offset and inertia take beside the features."""
    samples = motion.samples
    m, n = samples.q.shape
    base = EnergyDesign(samples.q, np.ones((m, n))).columns(features).reshape(n, m, -1)
    taken = np.zeros((m, n))
    for joint in range(n):
        extra = np.column_stack([motion.direction(joint), samples.qd[:, joint],
                                 motion.qdd[:, joint], np.ones(m)])
        x = np.linalg.lstsq(np.column_stack([base[joint], extra]), samples.tau[:, joint],
                            rcond=1e-10)[0]
        taken[:, joint] = extra @ x[-extra.shape[1]:]
    return taken


def _level(model: GravityModel, q: FloatArray) -> GravityModel:
    """Return the model without features of the first joint, if they are small."""
    energy, n = model.energy, model.n_joints
    if energy is None or n < 2:
        return model
    first = dictionary.digits(energy.indices, n)[:, 0] != dictionary.ONE
    rms = np.sqrt((model.predict(q) ** 2).mean(axis=0))
    if not first.any() or rms[0] > _NEARLY_LEVEL * rms.max():
        return model
    kept = Expansion(energy.indices[~first], energy.weights[~first])
    return GravityModel.from_energy(model.joints, model.formulation, kept, model.noise,
                                    model.coverage, model.provenance)
