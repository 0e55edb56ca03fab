"""
Few-sample update: a model after a tool change, from the model before it and seconds of motion.

A tool changes few of the coefficients of a model: some moments of a chain, some weights of an
energy. All others keep their values and their uncertainty (`update_step`). Where the arm's lengths
are known a tool is only four numbers (`payload_estimate`), and the model changes by them, unless
the samples show that something else changed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion import accelerations
from gravity_comp_ros.errors import FitError, ModelMismatchError, OptionError
from gravity_comp_ros.estimation import robust
from gravity_comp_ros.estimation.chain_update import NewSamples
from gravity_comp_ros.estimation.nominal_motion import MOTION_EFFECTS, motion_torque
from gravity_comp_ros.estimation.nuisance_columns import nuisance_torque
from gravity_comp_ros.estimation.payload_estimate import on_known_axes, weigh
from gravity_comp_ros.estimation.payload_path import payload_path
from gravity_comp_ros.estimation.update_report import details, UpdateDetails
from gravity_comp_ros.estimation.update_step import step
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.nuisance import NuisanceTerms
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.models.uncertainty import ChainUncertainty
import numpy as np

# Shorter correlation times than this are what chance makes of white noise.
_WHITE = 2.0
# Noise that the new samples show to differ by no more changes no weights that matter.
_SAME_NOISE = 0.15


@dataclass(frozen=True)
class UpdateOptions:
    """
    How an update is made.

    `min_samples` are asked for at least; `old_noise` is how many samples the noise of the old
    model's training counts for beside that of the new ones.

    :raises OptionError: if a value is out of range.
    """

    min_samples: int = 10
    old_noise: float = 50.0

    def __post_init__(self) -> None:
        if self.min_samples < 2:
            raise OptionError(f'update: min_samples is {self.min_samples}; it must be 2 or more')
        if not 0.0 < self.old_noise < np.inf:
            raise OptionError(f'update: old_noise is {self.old_noise}; it must be positive')


@dataclass(frozen=True)
class UpdateResult:
    """The model with the new tool, and what is to be said of it."""

    model: GravityModel
    report: UpdateDetails


def update(model: GravityModel, samples: JointSamples,
           options: UpdateOptions = UpdateOptions(),
           geometry: Geometry | None = None, qdd: FloatArray | None = None) -> UpdateResult:
    """
    Return the model that explains `samples`, taken after a tool change, by a sparse change.

    On known axes the torque of motion of a nominal arm with the tool is taken off first.

    :param model: of the chain or the potential formulation.
    :param samples: gated; joints are matched by name. Fifty (10 s at 5 Hz) are a good number.
        Their torque is gravity: what the effects of the model do must have been taken off.
    :param geometry: of this arm, to weigh the tool; the new model is a chain on its axes, with
        the joints in its order.
    :param qdd: accelerations (M, N) in rad/s^2 of the samples; None computes them.
    :raises ModelMismatchError: if the samples lack a joint, the model is per_joint and there is
        no geometry, or the geometry is of another arm.
    :raises FitError: if there are too few samples.
    """
    names, samples = samples.names, samples.joints(model.joints)
    if samples.n_samples < options.min_samples:
        raise FitError(f'{samples.n_samples} slow samples since the tool changed; an update needs '
                       f'{options.min_samples}. Move on slowly')
    if geometry is not None:
        base, here = _on_axes(model, geometry), samples.joints(geometry.joints)
        if any(effect.name in MOTION_EFFECTS for effect in model.applied.effects):
            qdd = None
        elif qdd is None:
            qdd = accelerations(here)
        else:
            qdd = qdd[:, [names.index(name) for name in geometry.joints]]
        return _update(base, here, options, base.geometry, qdd)
    if model.energy is None:
        raise ModelMismatchError('a per_joint model has no energy whose change a tool would be; '
                                 'fit it again, or keep a chain or potential model')
    return _update(model, samples, options, None, None)


def _update(model: GravityModel, measured: JointSamples, options: UpdateOptions,
            geometry: Geometry | None, qdd: FloatArray | None) -> UpdateResult:
    # Friction and offsets that were seen before the change are carried over.
    samples = replace(measured, tau=measured.tau - nuisance_torque(model.nuisance, measured))
    sigma = np.maximum(model.noise_with_nuisance, noise.floor(samples.tau))
    new = NewSamples(samples.q, samples.tau, sigma, change_trust(model, samples))
    if geometry is not None and qdd is not None:
        samples = _without_motion(model, samples, new, geometry, qdd)
        new = NewSamples(samples.q, samples.tau, sigma, change_trust(model, samples))
    found = step(model, new, geometry)
    sigma = _noise(found.model, samples, new, options)
    if not np.allclose(sigma, new.sigma, rtol=_SAME_NOISE):
        found = step(model, replace(new, sigma=sigma), geometry, found.start)
    # Errors are those of the model as it predicts, friction that it does not predict included.
    rmse = np.sqrt(((measured.tau - found.model.predict(measured.q)) ** 2).mean(axis=0))
    report = details(model, found, measured, rmse, sigma)
    provenance = {**model.provenance,
                  'updates': [*model.provenance.get('updates', []), report.to_json()]}
    nuisance = found.model.nuisance
    if nuisance.noise.size:
        nuisance = NuisanceTerms(nuisance.terms, nuisance.width, nuisance.hold, sigma)
    updated = replace(found.model, noise=np.maximum(sigma, rmse), nuisance=nuisance,
                      coverage=_coverage(model, samples), provenance=provenance,
                      payload_path=payload_path(model, found.model))
    return UpdateResult(updated, report)


def _without_motion(model: GravityModel, samples: JointSamples, new: NewSamples,
                    geometry: Geometry, qdd: FloatArray) -> JointSamples:
    """Return samples without the torque of motion of the nominal arm with the tool."""
    assert model.chain is not None and model.uncertainty is not None
    tool = weigh(model.chain, model.uncertainty.covariance, new, geometry)
    moments = tool.chain.moments / STANDARD_GRAVITY
    return replace(samples, tau=samples.tau - motion_torque(samples, geometry, moments, qdd))


def change_trust(model: GravityModel, samples: JointSamples) -> FloatArray:
    """
    Return how far each torque is trusted (M, N): transients and pushes are no tool.

    :param model: of the arm before the change, a chain or a potential.
    :param samples: after the change; their torque is gravity.
    """
    if model.chain is not None:
        columns = ForwardKinematics(model.chain.axes, samples.q).moment_columns()
    else:
        assert model.energy is not None
        design = EnergyDesign(samples.q, np.ones(samples.tau.shape))
        columns = design.columns(model.energy.indices).T.reshape(-1, *samples.tau.T.shape)
    return robust.trust_beside(samples.tau - model.predict(samples.q), columns,
                               noise.floor(samples.tau))


def _on_axes(model: GravityModel, geometry: Geometry) -> GravityModel:
    """Return the same gravity as a chain on known axes."""
    chain, covariance, geometry = on_known_axes(model, geometry)
    order = [model.joints.index(name) for name in geometry.joints]
    coverage = replace(model.coverage, q_min=model.coverage.q_min[order],
                       q_max=model.coverage.q_max[order])
    made = GravityModel.from_energy(
        geometry.joints, 'chain', expand(chain), model.noise[order], coverage, model.provenance,
        chain, ChainUncertainty(chain, covariance))
    direction = {name: numbers[order] for name, numbers in model.applied.direction.items()}
    return replace(made, applied=replace(model.applied, direction=direction),
                   history=model.history, nuisance=model.nuisance.in_order(order),
                   geometry=geometry)


def _noise(fitted: GravityModel, samples: JointSamples, new: NewSamples,
           options: UpdateOptions) -> FloatArray:
    """Return each joint's noise (N,), from training and from the residual of the new samples."""
    residual = np.sqrt(new.trust) * (new.tau - fitted.predict(new.q))
    times = np.array([noise.correlation_time(column, samples.runs) for column in residual.T])
    inflation = np.where(times < _WHITE, 1.0, times)
    squares = inflation * (residual ** 2).sum(axis=0)
    return np.asarray(np.sqrt((options.old_noise * new.sigma ** 2 + squares)
                              / (options.old_noise + new.trust.sum(axis=0))))


def _coverage(model: GravityModel, samples: JointSamples) -> Coverage:
    """Return the range that old and new samples span: the old ones taught all but the change."""
    return Coverage(np.minimum(model.coverage.q_min, samples.q.min(axis=0)),
                    np.maximum(model.coverage.q_max, samples.q.max(axis=0)),
                    samples.n_samples, samples.n_runs)
