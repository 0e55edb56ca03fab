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

from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.diagnosis.gravity_on_axes import chain_on_axes, columns_on_axes
from gravity_comp_ros.diagnosis.serial_arm import fit_chain, fit_serial_arm, tangent
from gravity_comp_ros.diagnosis.torque_of_motion import beside, left_beside
from gravity_comp_ros.effects.arm_dynamics import described_dynamics
from gravity_comp_ros.effects.motion import build_motion, Motion
from gravity_comp_ros.effects.motion_fit import MotionProblem
from gravity_comp_ros.effects.predict import installed, joint_number
from gravity_comp_ros.models.base_level import levelled
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
from gravity_comp_ros.models.kinematic.chain_fit import rough_fit
from gravity_comp_ros.models.kinematic.chain_starts import SearchOptions
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.models.sparse.potential import fit_potential
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.models.sparse.sparse_problem import SparseOptions
import numpy as np

_ROUGH_SAMPLES = 500
_SAMPLES = 1500
# First moments of a described arm settle in a few turns.
_TURNS = 3
# A sparse energy of more joints is too dear to seek; of a serial arm's so many terms are kept.
# With that many a model predicts as the chain that it is, so that its torque is exact.
_MOST_JOINTS, _MOST_TERMS = 9, 1500
# What is missing is still in the torque and correlated over seconds: a few samples count as one.
_CAUTIOUS = SparseOptions(inflation=4.0)
# Directions of the base that this motion excites less, next to the most excited, are left out.
_EXCITED = 1e-3
# Another base must take this part off some joint's error, or it is the same.
_WORTHWHILE = 0.01


@dataclass(frozen=True)
class Base:
    """
    The gravity model, the motion, the regressor (M, N, K) of gravity, and the serial arm in it.

    The columns are combinations of gravity's terms, of about the same size and not alike, and
    after them those of the effects that the model has, `given`, whose sizes may change beside
    others. `left` (M, N) in N·m is what gravity, friction, offset and motion leave.
    """

    model: GravityModel
    motion: Motion
    columns: FloatArray
    left: FloatArray
    chain: Chain | None = None
    given: frozenset[tuple[str, int | None]] = frozenset()


def choose_base(samples: JointSamples, model: GravityModel | None, most: int) -> Base:
    """
    Return the gravity to refit with effects.

    Gravity is chosen from the samples alone, so that a diagnosis does not depend on the
    formulation of the user's model. Where that model lies on the axes of a description, these are
    taken.

    :param samples: without the torque of the effects that the model has.
    :param model: the user's model, whose effects are `Base.given`; None if there is none.
    :param most: of so many samples or fewer the base and its motion are.
    """
    rows = evenly_picked(samples.n_samples, most)
    part = samples.select(rows)
    few = samples.select(evenly_picked(samples.n_samples, _ROUGH_SAMPLES))
    axes = model.geometry if model is not None and model.chain is not None else None
    found = _from_torques(part, few) if axes is None else _on_axes(axes, part, few)
    chosen = found.model
    if model is not None:
        chosen = replace(chosen, applied=model.applied, history=model.history)
    # Directions and accelerations are those of all samples.
    motion = replace(build_motion(samples, chosen).at(rows), chain=found.arm)
    given = frozenset((applied.name, None if applied.joint is None else
                       joint_number(chosen, applied)) for applied in chosen.applied.effects)
    columns = _columns(chosen, motion, found.chain)
    left = left_beside(columns, motion) if found.left is None else found.left
    return Base(chosen, motion, columns, left, found.chain, given)


@dataclass(frozen=True, eq=False)
class _Gravity:
    """
    A gravity model; the serial arm whose derivatives join it; `arm`, that of the torque of motion.

    `left` (M, N) in N·m is what gravity, friction and motion leave, None if it is not known.
    """

    model: GravityModel
    chain: Chain | None = None
    arm: Chain | None = None
    left: FloatArray | None = None


def _on_axes(axes: Geometry, part: JointSamples, few: JointSamples) -> _Gravity:
    """Return the gravity of an arm whose axes a description gives, beside the torque of motion."""
    chosen = _with_axes(axes, few)
    motion = build_motion(part, chosen)
    rows = evenly_picked(part.n_samples, _SAMPLES)
    # The nominal arm of rigid-body dynamics has the first moments of gravity, which then change.
    for _ in range(_TURNS):
        dynamics = described_dynamics(chosen)
        assert dynamics is not None and chosen.chain is not None
        columns = columns_on_axes(chosen.chain, part.q)
        found = MotionProblem.of(columns, 2, motion, dynamics).fit()
        cleaned = replace(part, tau=part.tau - found.beside)
        chosen = levelled(_with_axes(axes, cleaned.select(rows)), part.q)
    return _Gravity(chosen, left=cleaned.tau - chosen.predict(part.q))


def _from_torques(part: JointSamples, few: JointSamples) -> _Gravity:
    """Return the gravity of an arm of which nothing else is known."""
    choose = _potential if part.n_joints <= _MOST_JOINTS else _serial
    first = choose(few)
    motion = build_motion(part, first).at(evenly_picked(part.n_samples, _SAMPLES))
    samples = motion.samples
    columns = _model_columns(first, samples.q)
    cleaned = replace(samples, tau=samples.tau - beside(columns, motion))
    level = _model_columns(levelled(first, part.q), samples.q)
    arm = fit_serial_arm(motion, cleaned, left_beside(level, motion))
    if arm is None:
        return _Gravity(levelled(choose(cleaned), part.q), fit_chain(cleaned, None))
    return _Gravity(levelled(choose(arm.cleaned), part.q), arm.chain, arm.chain)


def _potential(samples: JointSamples) -> GravityModel:
    """
    Return the sparse energy that explains the torques.

    Nuisance terms were taken off before (`_beside_gravity`), or are what the first fit is to show.
    """
    energy, _ = fit_potential(samples, _CAUTIOUS)
    return _model(samples, 'potential', energy)


def _with_axes(axes: Geometry, samples: JointSamples) -> GravityModel:
    """Return the gravity of the serial arm on given axes that fits the torques."""
    return replace(_of_chain(chain_on_axes(axes.rotations, samples), samples), geometry=axes)


def _serial(samples: JointSamples) -> GravityModel:
    """Return the serial arm that fits, of more joints than a sparse energy is sought for."""
    return _of_chain(rough_fit(samples, SearchOptions()).chain, samples)


def _of_chain(chain: Chain, samples: JointSamples) -> GravityModel:
    return _model(samples, 'chain', _largest(expand(chain)), chain)


def _model(samples: JointSamples, formulation: str, energy: Expansion,
           chain: Chain | None = None) -> GravityModel:
    """Return the model of an energy, with the noise that it leaves of the samples."""
    found = GravityModel.from_energy(samples.names, formulation, energy,
                                     np.zeros(samples.n_joints), Coverage.of(samples), {}, chain)
    left = samples.tau - found.predict(samples.q)
    return replace(found, noise=np.sqrt((left ** 2).mean(axis=0)))


def _largest(energy: Expansion) -> Expansion:
    """Return the largest terms of an energy: effects that are made of its terms take no more."""
    kept = np.sort(np.argsort(-np.abs(energy.weights), kind='stable')[:_MOST_TERMS])
    return Expansion(energy.indices[kept], energy.weights[kept])


def refined(base: Base, effects: FloatArray) -> Base | None:
    """
    Return the base as it is once effects are taken off the torque; None if that is the same.

    :param effects: (M, N) N·m, what was found beside gravity.
    """
    samples = base.motion.samples
    if base.model.geometry is not None:
        return None
    cleaned = replace(samples, tau=samples.tau - effects)
    chain = fit_chain(cleaned, base.chain)
    columns = _columns(base.model, base.motion, chain)
    few = evenly_picked(samples.n_samples, _SAMPLES)
    before, after = (_left(part[few], cleaned.tau[few]) for part in (base.columns, columns))
    if (after > (1.0 - _WORTHWHILE) * before).all():
        return None
    return replace(base, columns=columns, chain=chain)


def _left(columns: FloatArray, tau: FloatArray) -> FloatArray:
    """Return what columns (M, N, K) leave of each joint's mean squared torque: (N,)."""
    flat = columns.reshape(tau.size, -1)
    x = lstsq(flat, tau.ravel(), rcond=1e-10)
    return np.asarray(((tau - (flat @ x).reshape(tau.shape)) ** 2).mean(axis=0))


def _model_columns(model: GravityModel, q: FloatArray) -> FloatArray:
    """Return the regressor (M, N, K) of the moments of a chain, or of an energy's features."""
    if model.chain is not None:
        columns = ForwardKinematics(model.chain.axes, q).moment_columns()
        return np.ascontiguousarray(columns.transpose(2, 1, 0))
    features = model.energy.indices if model.energy else np.zeros(0, dtype=np.int64)
    flat = EnergyDesign(q, np.ones(q.shape)).columns(features)
    return flat.reshape(q.shape[1], q.shape[0], -1).transpose(1, 0, 2)


def _columns(model: GravityModel, motion: Motion, chain: Chain | None) -> FloatArray:
    q = motion.samples.q
    parts = [] if chain is None else [tangent(q, chain)]
    if model.chain is None or model.geometry is not None:
        parts.insert(0, _model_columns(model, q))
    gravity = np.concatenate(parts, axis=2)
    return np.concatenate([_reduced(gravity), *_given_columns(model, motion)], axis=2)


def _given_columns(model: GravityModel, motion: Motion) -> list[FloatArray]:
    """Return the columns (M, N, K) of each effect that the model has."""
    return [installed(applied).columns_of_arm(motion, joint_number(model, applied),
                                              applied.setting)
            for applied in model.applied.effects]


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
