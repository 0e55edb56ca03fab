"""
Base model of a diagnosis: gravity and its regressor, to which effects are added.

The base is chosen first, with friction, an offset and inertia projected out of the torque, so
that gravity terms do not absorb them. The regressor is the derivatives of the fitted serial arm by
its parameters. If no serial arm fits the torque, it includes the terms of a sparse energy: a
gravity term that is missing would appear as an effect. On a nearly level base, terms of the first
joint are left out: gravity has none, and torque that depends on the first joint then remains for
an effect (base tilt).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.diagnosis.gravity_on_axes import chain_on_axes, columns_on_axes
from gravity_comp_ros.diagnosis.nuisance import nuisance_torque, residual_torque
from gravity_comp_ros.diagnosis.serial_arm import fit_chain, fit_serial_arm, level_arm, tangent
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

# Numbers of samples of the first fit and of later ones.
_ROUGH_SAMPLES = 500
_SAMPLES = 1500
# Iterations between gravity and dynamics of an arm with known axes.
_ITERATIONS = 3
# Maximum number of joints for a sparse energy, and of terms kept of a chain's energy. The model
# predicts with the chain itself, so that its torque is exact.
_MAX_JOINTS, _MAX_TERMS = 9, 1500
# Effects that are not modelled yet leave a residual that is autocorrelated over seconds.
_CAUTIOUS = SparseOptions(inflation=4.0)
# Minimum singular value of a direction of the base, relative to the largest.
_MIN_EXCITATION = 1e-3
# Minimum share of a joint's squared error that a refined base removes.
_MIN_IMPROVEMENT = 0.01


@dataclass(frozen=True)
class Base:
    """
    The gravity model, the motion, the regressor (M, N, K) of gravity, and the serial arm in it.

    The columns are orthogonal combinations of gravity terms, followed by the columns of `given`,
    the effects that the model includes already and whose coefficients are estimated again.
    `residual` (M, N) in N·m is that of gravity, friction, offset and dynamics.
    """

    model: GravityModel
    motion: Motion
    columns: FloatArray
    residual: FloatArray
    chain: Chain | None = None
    given: frozenset[tuple[str, int | None]] = frozenset()


def choose_base(samples: JointSamples, model: GravityModel | None, max_samples: int) -> Base:
    """
    Return the base model, estimated from the samples.

    The result does not depend on the formulation of the user's model, whose chain is only a
    further start of the search. If that model has the axes of a robot description, these axes are
    used.

    :param samples: torque without the effects that the model includes.
    :param model: the user's model, whose effects become `Base.given`; None if there is none.
    :param max_samples: maximum number of samples of the base and its motion.
    """
    rows = evenly_picked(samples.n_samples, max_samples)
    part = samples.select(rows)
    few = samples.select(evenly_picked(samples.n_samples, _ROUGH_SAMPLES))
    axes = model.geometry if model is not None and model.chain is not None else None
    start = model.chain if model is not None and axes is None else None
    gravity = (_from_torques(part, few, start) if axes is None
               else _on_axes(axes, part, few))
    chosen = gravity.model
    if model is not None:
        chosen = replace(chosen, applied=model.applied, history=model.history)
    # Directions and accelerations are computed from all samples.
    motion = replace(build_motion(samples, chosen).at(rows),
                     chain=gravity.arm or _arm_of_effects(model))
    given = frozenset((applied.name, None if applied.joint is None else
                       joint_number(chosen, applied)) for applied in chosen.applied.effects)
    columns = _columns(chosen, motion, gravity.chain)
    residual = (residual_torque(columns, motion) if gravity.residual is None
                else gravity.residual)
    return Base(chosen, motion, columns, residual, gravity.chain, given)


def _arm_of_effects(model: GravityModel | None) -> Chain | None:
    """
    Return the serial arm of a model with rigid-body dynamics, None without.

    Columns of an effect that the model includes are required even if no serial arm fits this
    torque.
    """
    if model is None or all(x.name != 'rigid_body_dynamics' for x in model.applied.effects):
        return None
    return model.chain


@dataclass(frozen=True, eq=False)
class _Gravity:
    """
    A gravity model; the chain whose derivatives extend it; `arm`, the chain of the dynamics.

    `residual` (M, N) in N·m is that of gravity, friction and dynamics; None if not computed.
    """

    model: GravityModel
    chain: Chain | None = None
    arm: Chain | None = None
    residual: FloatArray | None = None


def _on_axes(axes: Geometry, part: JointSamples, few: JointSamples) -> _Gravity:
    """Return the gravity on known axes, estimated jointly with the dynamics."""
    chosen = _with_axes(axes, few)
    motion = build_motion(part, chosen)
    rows = evenly_picked(part.n_samples, _SAMPLES)
    # The nominal arm of the dynamics has the first moments of the current gravity estimate.
    for _ in range(_ITERATIONS):
        dynamics = described_dynamics(chosen)
        assert dynamics is not None and chosen.chain is not None
        columns = columns_on_axes(chosen.chain, part.q)
        fit = MotionProblem.of(columns, 2, motion, dynamics).fit()
        cleaned = replace(part, tau=part.tau - fit.nuisance)
        chosen = levelled(_with_axes(axes, cleaned.select(rows)), part.q)
    return _Gravity(chosen, residual=cleaned.tau - chosen.predict(part.q))


def _from_torques(part: JointSamples, few: JointSamples, start: Chain | None) -> _Gravity:
    """Return the gravity of an arm without a description."""
    choose = _potential if part.n_joints <= _MAX_JOINTS else _serial
    first = choose(few)
    motion = build_motion(part, first).at(evenly_picked(part.n_samples, _SAMPLES))
    samples = motion.samples
    columns = _model_columns(first, samples.q)
    cleaned = replace(samples, tau=samples.tau - nuisance_torque(columns, motion))
    reference = residual_torque(_model_columns(levelled(first, part.q), samples.q), motion)
    arm = fit_serial_arm(motion, cleaned, reference, start)
    if arm is None:
        return _Gravity(levelled(choose(cleaned), part.q), fit_chain(cleaned, None))
    level = level_arm(arm.chain, part.q)
    return _Gravity(_of_chain(level, arm.cleaned), arm.chain, arm.chain)


def _potential(samples: JointSamples) -> GravityModel:
    """Return the sparse energy that fits the torques; nuisance terms are not fitted here."""
    energy, _ = fit_potential(samples, _CAUTIOUS)
    return _model(samples, 'potential', energy)


def _with_axes(axes: Geometry, samples: JointSamples) -> GravityModel:
    """Return the gravity of a serial arm with known axes."""
    return replace(_of_chain(chain_on_axes(axes.rotations, samples), samples), geometry=axes)


def _serial(samples: JointSamples) -> GravityModel:
    """Return the gravity of a serial arm, for more joints than a sparse energy can have."""
    return _of_chain(rough_fit(samples, SearchOptions()).chain, samples)


def _of_chain(chain: Chain, samples: JointSamples) -> GravityModel:
    return _model(samples, 'chain', _largest(expand(chain)), chain)


def _model(samples: JointSamples, formulation: str, energy: Expansion,
           chain: Chain | None = None) -> GravityModel:
    """Return the model of an energy; its noise (N,) is the RMS residual in N·m."""
    model = GravityModel.from_energy(samples.names, formulation, energy,
                                     np.zeros(samples.n_joints), Coverage.of(samples), {}, chain)
    residual = samples.tau - model.predict(samples.q)
    return replace(model, noise=np.sqrt((residual ** 2).mean(axis=0)))


def _largest(energy: Expansion) -> Expansion:
    """Return the largest terms of an energy, which limits the cost of effects built from them."""
    kept = np.sort(np.argsort(-np.abs(energy.weights), kind='stable')[:_MAX_TERMS])
    return Expansion(energy.indices[kept], energy.weights[kept])


def refined(base: Base, effects: FloatArray) -> Base | None:
    """
    Return the base refitted to the torque without effects; None if it is not better.

    :param effects: torque (M, N) of the chosen effects in N·m.
    """
    samples = base.motion.samples
    if base.model.geometry is not None:
        return None
    cleaned = replace(samples, tau=samples.tau - effects)
    chain = fit_chain(cleaned, base.chain)
    columns = _columns(base.model, base.motion, chain)
    few = evenly_picked(samples.n_samples, _SAMPLES)
    before, after = (_mean_squares(part[few], cleaned.tau[few])
                     for part in (base.columns, columns))
    if (after > (1.0 - _MIN_IMPROVEMENT) * before).all():
        return None
    return replace(base, columns=columns, chain=chain)


def _mean_squares(columns: FloatArray, tau: FloatArray) -> FloatArray:
    """Return the mean squared residual (N,) of each joint for columns (M, N, K)."""
    flat = columns.reshape(tau.size, -1)
    x = lstsq(flat, tau.ravel(), rcond=1e-10)
    return np.asarray(((tau - (flat @ x).reshape(tau.shape)) ** 2).mean(axis=0))


def _model_columns(model: GravityModel, q: FloatArray) -> FloatArray:
    """Return the regressor (M, N, K) of a chain's moments, or of an energy's features."""
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
    given = [installed(applied).columns_of_arm(motion, joint_number(model, applied),
                                               applied.setting)
             for applied in model.applied.effects]
    return np.concatenate([_identifiable(np.concatenate(parts, axis=2)), *given], axis=2)


def _identifiable(columns: FloatArray) -> FloatArray:
    """Return orthogonal combinations (M, N, K') of columns that this motion excites."""
    m, n, k = columns.shape
    flat = columns.reshape(m * n, k)
    size = np.sqrt((flat ** 2).mean(axis=0))
    used = size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)
    flat = flat[:, used] / size[used]
    values, vectors = np.linalg.eigh(flat.T @ flat / len(flat))
    excited = values > _MIN_EXCITATION ** 2 * values.max(initial=0.0)
    mixed = flat @ (vectors[:, excited] / np.sqrt(values[excited]))
    return np.asarray(mixed.reshape(m, n, -1))
