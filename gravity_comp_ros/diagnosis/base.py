"""
The gravity model that effects are judged beside.

The base comes first: it is chosen while friction, an offset and inertia are projected out of the
torque, so that it does not grow terms to imitate them. It has to hold all of gravity, or an
effect will be found that stands in for a small term of it: so to the terms of the sparse energy
come the directions in which a serial arm could still differ from the one that fits. A nearly
level arm is not given terms of its first joint: gravity has none there, and what the first
joint's angle does to the torque (a tilted base) is then left for an effect to explain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.diagnosis.nuisance import nuisance
from gravity_comp_ros.effects.effect import Motion
from gravity_comp_ros.effects.motion import build_motion
from gravity_comp_ros.effects.predict import effect_torque, installed, joint_number
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.estimation.base_level import is_level, levelled
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_fit import fit_chain
from gravity_comp_ros.models.sparse.potential import fit_potential
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.models.sparse.sparse_problem import SparseOptions
import numpy as np

_SAMPLES = 1500
_CHAIN_SAMPLES = 500
# What is missing is still in the torque and correlated over seconds: a few samples count as one.
_CAUTIOUS = SparseOptions(inflation=4.0)
# Directions of the base that this motion excites less, next to the most excited, are left out.
_EXCITED = 1e-3
# Another base must take this part off some joint's error, or it is the same.
_WORTHWHILE = 0.01


@dataclass(frozen=True)
class Base:
    """
    The gravity model, the motion as effects see it, and the columns (M, N, K) of every fit.

    The columns are combinations of gravity's terms, of about the same size and not alike, and
    after them those of the effects that the model has, `given`, whose sizes may change beside
    others.
    """

    model: GravityModel
    motion: Motion
    columns: FloatArray
    given: frozenset[tuple[str, int | None]] = frozenset()


def choose_base(samples: JointSamples, model: GravityModel | None) -> Base:
    """
    Return the gravity to refit with effects.

    :param model: the user's model if there is one, and if it has an energy; else one is fitted.
    """
    few = _thin(samples, _SAMPLES)
    known = model is not None and model.energy is not None and model.chain is None
    taken = np.zeros(samples.q.shape)
    if model is not None and model.chain is not None:
        # A chain is fitted anew as an energy: the diagnosis must not depend on the formulation.
        taken = effect_torque(model, samples)
    if model is not None and known:
        rough = model
    else:
        rough = _potential(replace(samples, tau=samples.tau - taken).select(few))
    motion = build_motion(samples, rough)
    cleaned = replace(samples, tau=samples.tau - _nuisance(motion, rough))
    kept = replace(cleaned, tau=cleaned.tau - taken).select(few)
    chosen = rough if known else _potential(kept)
    if model is not None and model.chain is not None:
        chosen = replace(chosen, applied=model.applied, history=model.history)
    chosen = levelled(chosen, samples.q)
    motion = build_motion(samples, chosen)
    given = frozenset((applied.name, None if applied.joint is None else
                       joint_number(chosen, applied)) for applied in chosen.applied.effects)
    return Base(chosen, motion, _columns(chosen, motion, cleaned), given)


def _potential(samples: JointSamples) -> GravityModel:
    """
    Return the sparse energy that explains the torques.

    Nuisance terms were taken off before (`_nuisance`), or are what the first fit is to show.
    """
    energy, _ = fit_potential(samples, _CAUTIOUS)
    coverage = Coverage(samples.q.min(axis=0), samples.q.max(axis=0), samples.n_samples,
                        samples.n_runs)
    model = GravityModel.from_energy(samples.names, 'potential', energy,
                                     np.zeros(samples.n_joints), coverage, {})
    left = samples.tau - model.predict(samples.q)
    return replace(model, noise=np.sqrt((left ** 2).mean(axis=0)))


def refined(base: Base, effects: FloatArray) -> Base | None:
    """
    Return the base as it is once effects are taken off the torque; None if that is the same.

    :param effects: (M, N) N·m, what was found beside gravity.
    """
    samples = base.motion.samples
    cleaned = replace(samples, tau=samples.tau - effects)
    columns = _columns(base.model, base.motion, cleaned)
    few = _thin(samples, _SAMPLES)
    before, after = (_left(part[few], cleaned.tau[few]) for part in (base.columns, columns))
    if (after > (1.0 - _WORTHWHILE) * before).all():
        return None
    return replace(base, columns=columns)


def _left(columns: FloatArray, tau: FloatArray) -> FloatArray:
    """Return what columns (M, N, K) leave of each joint's mean squared torque: (N,)."""
    flat = columns.reshape(tau.size, -1)
    x = np.linalg.lstsq(flat, tau.ravel(), rcond=1e-10)[0]
    return np.asarray(((tau - (flat @ x).reshape(tau.shape)) ** 2).mean(axis=0))


def _model_columns(model: GravityModel, q: FloatArray) -> FloatArray:
    """Return how a model's torques (M, N, K) change with its numbers."""
    if model.chain is not None:
        return model.chain.jacobian(q).transpose(2, 1, 0)
    features = model.energy.indices if model.energy else np.zeros(0, dtype=np.int64)
    flat = EnergyDesign(q, np.ones(q.shape)).columns(features)
    return flat.reshape(q.shape[1], q.shape[0], -1).transpose(1, 0, 2)


def _columns(model: GravityModel, motion: Motion, cleaned: JointSamples) -> FloatArray:
    gravity = _tangent(cleaned)
    if model.chain is None:
        gravity = np.concatenate([_model_columns(model, cleaned.q), gravity], axis=2)
    return np.concatenate([_reduced(gravity), *_given_columns(model, motion)], axis=2)


def _given_columns(model: GravityModel, motion: Motion) -> list[FloatArray]:
    """Return the columns (M, N, K) of each effect that the model has."""
    parts = []
    for applied in model.applied.effects:
        effect, joint = installed(applied), joint_number(model, applied)
        columns = effect.columns(motion, joint, applied.setting)
        if effect.scope != 'arm':
            whole = np.zeros((*motion.samples.q.shape, columns.shape[1]))
            whole[:, joint] = columns
            columns = whole
        parts.append(columns)
    return parts


def _tangent(cleaned: JointSamples) -> FloatArray:
    """Return how the torques (M, N, K) of the serial arm that fits change with its numbers."""
    m, n = cleaned.q.shape
    try:
        chain = fit_chain(cleaned.select(_thin(cleaned, _CHAIN_SAMPLES))).chain
    except GravityCompError:
        return np.zeros((m, n, 0))
    level = is_level(chain.torque(cleaned.q))
    if level and n > 1:
        axes = chain.axes.copy()
        axes[0] = np.eye(3) if axes[0, 2, 2] > 0.0 else np.diag([1.0, -1.0, -1.0])
        chain = Chain(axes, chain.moments)
    columns = chain.jacobian(cleaned.q).transpose(2, 1, 0)
    return columns[:, :, 2:] if level and n > 1 else columns


def _reduced(columns: FloatArray) -> FloatArray:
    """Return combinations (M, N, K') of columns that this motion tells apart."""
    m, n, k = columns.shape
    flat = columns.reshape(m * n, k)
    size = np.sqrt((flat ** 2).mean(axis=0))
    used = size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)
    flat = flat[:, used] / size[used]
    values, vectors = np.linalg.eigh(flat.T @ flat / len(flat))
    excited = values > _EXCITED ** 2 * values.max(initial=0.0)
    mixed = flat @ (vectors[:, excited] / np.sqrt(values[excited]))
    return np.asarray(mixed.reshape(m, n, -1))


def _thin(samples: JointSamples, count: int) -> BoolArray:
    return np.arange(samples.n_samples) % max(1, samples.n_samples // count) == 0


def _nuisance(motion: Motion, model: GravityModel) -> FloatArray:
    """Return the torque (M, N) that friction, offset and inertia take beside gravity."""
    samples = motion.samples
    m, n = samples.q.shape
    base = _model_columns(model, samples.q)
    taken = np.zeros((m, n))
    for joint in range(n):
        extra = nuisance(motion, joint)
        x = np.linalg.lstsq(np.column_stack([base[:, joint], extra]), samples.tau[:, joint],
                            rcond=1e-10)[0]
        taken[:, joint] = extra @ x[-extra.shape[1]:]
    return taken
