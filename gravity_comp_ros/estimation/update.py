"""
Few-sample update of a model after a payload change.

A payload changes few moments of a chain. All other coefficients keep their values and their
uncertainty. With known link lengths a payload is only four parameters; the model changes by these
unless the samples show a different change (`update_step`). A potential is changed as the chain
that explains it (`chain_of_model`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.differentiation import accelerations
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion_direction import law_of
from gravity_comp_ros.effects.offset import offset_std
from gravity_comp_ros.effects.predict import fitted_torque, torque_of
from gravity_comp_ros.effects.rigid_body import DYNAMICS
from gravity_comp_ros.errors import FitError, ModelMismatchError
from gravity_comp_ros.estimation import robust
from gravity_comp_ros.estimation.chain_of_model import as_chain, on_axes
from gravity_comp_ros.estimation.chain_update import NewSamples
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.estimation.payload_path import payload_path
from gravity_comp_ros.estimation.update_report import details, UpdateDetails
from gravity_comp_ros.estimation.update_step import changed_model, estimate_payload, UpdateStep
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.nominal_arm import nominal_parameters
from gravity_comp_ros.models.kinematic.rigid_body import inverse_dynamics
import numpy as np


@dataclass(frozen=True)
class UpdateResult:
    """The updated model and the report of the update."""

    model: GravityModel
    report: UpdateDetails


def update(model: GravityModel, samples: JointSamples,
           geometry: Geometry | None = None) -> UpdateResult:
    """
    Update a model to samples recorded after a payload change, by a sparse change of a chain.

    With known axes the dynamic torque of a nominal arm with the payload is subtracted first, or
    that of the payload alone if the model has the dynamics of the arm.

    :param model: a chain, or a potential that a chain explains.
    :param samples: gated; joints are matched by name. Fifty (10 s at 5 Hz) are a good number.
        Their torque is gravity: the torque of the model's effects must have been subtracted.
    :param geometry: of this arm, to estimate the payload; the new model is a chain on its axes,
        with the joints in its order.
    :raises ModelMismatchError: if a joint is missing from the samples, no chain explains the
        model, or the geometry is of another arm.
    :raises FitError: if there are too few samples.
    """
    samples = samples.joints(model.joints)
    if samples.n_samples < OPTIONS.min_samples:
        raise FitError(f'{samples.n_samples} slow samples since the payload changed; an update '
                       f'needs {OPTIONS.min_samples}. Keep the arm moving slowly')
    if geometry is not None:
        return _with_payload(model, samples, geometry)
    chain = as_chain(model)
    if chain is None:
        raise ModelMismatchError(f'no chain of joints explains this {model.formulation} model, of '
                                 f'which a payload could change the moments; fit it again')
    return _update(chain, samples, None)[0]


def _with_payload(model: GravityModel, samples: JointSamples, geometry: Geometry
                  ) -> UpdateResult:
    """
    Return the update on known axes, with the vertical and the zero angles of the model.

    Those of the description are compared where a payload does not explain the change: if a drive
    subtracts its own gravity, the model has too little of it to identify vertical and angles.
    """
    base = on_axes(model, geometry)
    samples = samples.joints(geometry.joints)
    result, step = _update(base, samples, base.geometry)
    if step.is_payload:
        return result
    try:
        described = on_axes(model, geometry, as_described=True)
    except ModelMismatchError:
        return result
    other, other_step = _update(described, samples, geometry)
    return other if other_step.misfit < step.misfit else result


def _update(model: GravityModel, measured: JointSamples, geometry: Geometry | None
            ) -> tuple[UpdateResult, UpdateStep]:
    """Return the update, and the change with the noise of the model."""
    # Friction and offsets identified before the change are kept.
    with_dynamics = any(effects.has(DYNAMICS, None) for effects in (model.applied, model.fitted))
    samples = replace(measured, tau=measured.tau - fitted_torque(model, measured))
    sigma = np.maximum(model.noise_with_nuisance, noise.floor(samples.tau))
    reversal = sigma ** 2 / (sigma ** 2 + reversal_std(model, measured) ** 2)
    new = _new_samples(model, samples, sigma, reversal)
    if geometry is not None:
        samples = _without_motion(model, samples, new, geometry, with_dynamics)
        new = _new_samples(model, samples, sigma, reversal)
    step = first = changed_model(model, new, geometry)
    sigma = _noise(step.model, samples, new)
    if not np.allclose(sigma, new.sigma, rtol=OPTIONS.noise):
        step = changed_model(model, replace(new, sigma=sigma), geometry, step.trials)
    # Errors are those of the model's own prediction; friction that it excludes counts as error.
    rmse = np.sqrt(((measured.tau - step.model.predict(measured.q)) ** 2).mean(axis=0))
    report = details(model, step, measured, rmse, sigma)
    provenance = {**model.provenance,
                  'updates': [*model.provenance.get('updates', []), report.to_json()]}
    updated = replace(step.model, noise=np.maximum(sigma, rmse), residual_std=sigma,
                      coverage=_coverage(model, samples), provenance=provenance,
                      payload_path=payload_path(model, step.model))
    return UpdateResult(updated, report), first


def _new_samples(model: GravityModel, samples: JointSamples, sigma: FloatArray,
                 reversal: FloatArray) -> NewSamples:
    """Return the samples with robust weights, times those of friction near reversals (M, N)."""
    return NewSamples(samples.q, samples.tau, sigma,
                      reversal * payload_change_weights(model, samples), offset_std(model))


def _without_motion(model: GravityModel, samples: JointSamples, new: NewSamples,
                    geometry: Geometry, with_dynamics: bool) -> JointSamples:
    """
    Subtract the dynamic torque of the nominal arm with the payload.

    Inertia would appear as a change of the moments: an acceleration of 0.1 rad/s^2 is like a
    degree of tilt.

    :param with_dynamics: whether the torque is without that of the arm before the change.
    """
    assert model.chain is not None and model.covariance is not None
    loaded = estimate_payload(model.chain, model.covariance_given_effects, new, geometry)
    nominal = nominal_parameters(geometry, loaded.chain.moments / STANDARD_GRAVITY)
    if with_dynamics:
        nominal -= nominal_parameters(geometry, model.chain.moments / STANDARD_GRAVITY)
    return replace(samples, tau=samples.tau - inverse_dynamics(
        geometry, samples.q, samples.qd, accelerations(samples), nominal))


def payload_change_weights(model: GravityModel, samples: JointSamples) -> FloatArray:
    """
    Return robust weights (M, N) of the samples; transients and pushes are outliers.

    The residual may contain any change of the model's coefficients, such as that by a payload.

    :param model: of the arm before the change, a chain.
    :param samples: after the change; their torque is gravity.
    """
    assert model.chain is not None
    columns = ForwardKinematics(model.chain.axes, samples.q).moment_columns()
    return robust.irls_weights(samples.tau - model.predict(samples.q), columns,
                               noise.floor(samples.tau))


def reversal_std(model: GravityModel, samples: JointSamples) -> FloatArray:
    """
    Return the standard deviation (M, N) in N·m of friction near reversals.

    The speed over which friction reverses depends on load and lubrication. In samples other than
    those of the fit it is uncertain by a factor (`EstimationOptions`).
    """
    def torque(factor: float) -> FloatArray:
        return torque_of(model, (replace(effect, setting={
            **effect.setting, **{name: factor * value for name, value in law.items()}})
            for effect in (*model.applied.effects, *model.fitted.effects)
            if (law := law_of(effect.setting))), samples)
    return np.asarray(0.5 * np.abs(torque(OPTIONS.reversal) - torque(1.0 / OPTIONS.reversal)))


def _noise(fitted: GravityModel, samples: JointSamples, new: NewSamples
           ) -> FloatArray:
    """Return the noise std (N,) of each joint, from training and the new residual together."""
    residual = new.sigma * new.in_noise((new.tau - fitted.predict(new.q)).T).T
    squares = noise.inflation(residual, samples.runs) * (residual ** 2).sum(axis=0)
    return np.asarray(np.sqrt((OPTIONS.old_noise * new.sigma ** 2 + squares)
                              / (OPTIONS.old_noise + new.robust_weights.sum(axis=0))))


def _coverage(model: GravityModel, samples: JointSamples) -> Coverage:
    """Return the range of old and new samples: only the payload is not covered by the old ones."""
    return Coverage(np.minimum(model.coverage.q_min, samples.q.min(axis=0)),
                    np.maximum(model.coverage.q_max, samples.q.max(axis=0)),
                    samples.n_samples, samples.n_runs)
