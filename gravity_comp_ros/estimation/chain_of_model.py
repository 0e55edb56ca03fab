"""
Gravity of a model as a chain of joints, against which a change of the payload is tested.

A potential model of a serial arm and its chain predict the same torque. A chain is fitted to the
torque of a model at the poses of its trained range with the smallest standard deviation. On known
axes a payload has four parameters.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
import pickle

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.rigid_body import DYNAMICS
from gravity_comp_ros.errors import FitError, ModelMismatchError
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.models.applied_effects import Applied
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain, expand
from gravity_comp_ros.models.kinematic.geometry import Geometry, same_axes
from gravity_comp_ros.regression.engine import regress
from gravity_comp_ros.regression.known_axes import KnownAxes
from gravity_comp_ros.regression.linear import with_common_terms
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.shared import Shared
from gravity_comp_ros.regression.start import start_axes
from gravity_comp_ros.regression.unknown_lengths import UnknownLengths
from gravity_comp_ros.regression.vertical import with_estimated_vertical
import numpy as np
from scipy.linalg import block_diag

# Minimum and maximum number of torques of a joint that replace a model's samples, and number of
# poses that are drawn for each. Those with the smallest standard deviation are kept.
_MIN_TORQUES, _MAX_TORQUES, _DRAWN = 200, 1000, 2


def axes_under(model: GravityModel, geometry: Geometry | None) -> Geometry | None:
    """Return the axes of a chain, its own or those described; None if it has neither."""
    return next((axes for axes in (model.geometry, geometry)
                 if axes is not None and _is_on(model, axes)), None)


def _is_on(model: GravityModel, axes: Geometry) -> bool:
    """Return whether a model is a chain on these axes, of the same joints in their order."""
    return model.chain is not None and model.joints == axes.joints and bool(
        np.abs(model.chain.axes[1:] - axes.rotations[1:]).max(initial=0.0) < 1e-6)


class ChainOfModel:
    """Converts models to chains; keeps the last one."""

    def __init__(self) -> None:
        self._key: bytes = b''
        self._chain: GravityModel | None = None

    def of(self, model: GravityModel, geometry: Geometry | None) -> GravityModel | None:
        """Return the gravity of a model as a chain, None where no chain explains it."""
        key = pickle.dumps((model, geometry))
        if key != self._key:
            self._key, self._chain = key, as_chain(model, geometry)
        return self._chain


def as_chain(model: GravityModel, geometry: Geometry | None = None) -> GravityModel | None:
    """
    Return the gravity of a model as a chain model of the same joints in the same order.

    :param geometry: axes of the arm where they are known; the chain then has these axes.
    """
    if geometry is not None and geometry.joints == model.joints:
        with suppress(ModelMismatchError):
            return on_axes(model, geometry)
    if model.chain is not None and model.covariance is not None:
        return model
    if model.covariance is None:
        return None
    with suppress(ModelMismatchError):
        return _fitted(model, None)
    return None


def on_axes(model: GravityModel, geometry: Geometry, *, as_described: bool = False
            ) -> GravityModel:
    """
    Return the gravity of a model as a chain on known axes, with the joints in their order.

    The axes have the vertical and the zero angles of the model. A chain that was fitted on them is
    returned as it is.

    :param as_described: whether to keep the vertical and the zero angles of `geometry`.
    :raises ModelMismatchError: if no moments on these axes reproduce the model: they are of
        another arm, or of one with other zero angles.
    """
    if sorted(model.joints) != sorted(geometry.joints):
        raise ModelMismatchError(f'the known axes are of {", ".join(geometry.joints)}, but the '
                                 f'model is of {", ".join(model.joints)}')
    if not as_described:
        own = model.geometry
        own = own if own is not None and same_axes(own, geometry) else geometry
        if model.chain is not None and model.covariance is not None and _is_on(model, own):
            return _on_chain(model, model.chain, model.covariance, own)
    return _fitted(model, geometry, as_described)


def _fitted(model: GravityModel, geometry: Geometry | None, as_described: bool = False
            ) -> GravityModel:
    """
    Return a chain with the torque of a model at poses of its trained range.

    :param geometry: the known axes; None without any.
    :raises ModelMismatchError: if the torque of no chain is that of the model.
    """
    samples, exact, noise = _drawn(model, model.joints if geometry is None else geometry.joints)
    try:
        problem = Problem.of(samples)
        shared = start_axes(problem, ()) if geometry is None else _described(
            geometry, problem, as_described)
        result = regress(problem, shared, ())
    except (FitError, np.linalg.LinAlgError) as error:
        raise ModelMismatchError(f'no chain has the torque of the model: {error}') from None
    shared = result.shared
    assert isinstance(shared, (KnownAxes, UnknownLengths))
    _check_misfit(exact - shared.chain.torque(samples.q), noise, samples.names)
    steps, p = shared.step_map(), len(shared.point)
    covariance = steps @ result.posterior.covariance[:p, :p] @ steps.T
    if model.covariance is not None:
        # What a split of gravity and effects changes of this chain is not known.
        covariance = block_diag(covariance, model.covariance_of_effects)
    return _on_chain(model, shared.chain, covariance,
                     shared.geometry if isinstance(shared, KnownAxes) else None)


def _described(geometry: Geometry, problem: Problem, as_described: bool) -> Shared:
    """Return the start on described axes, with its moments."""
    if as_described:
        return with_common_terms(problem, KnownAxes.of(geometry).at_near_angles(), ()).shared
    mounted = with_estimated_vertical(geometry, problem)
    return with_common_terms(problem, KnownAxes.of(mounted, mounted is geometry), ()).shared


def _drawn(model: GravityModel, joints: tuple[str, ...]
           ) -> tuple[JointSamples, FloatArray, FloatArray]:
    """
    Return samples with noise, their torque (M, N) without it, and the noise (N,) in N·m.

    Each pose is there twice, with opposite noise: it does not change the estimate.
    """
    rng, order = np.random.default_rng(0), [model.joints.index(name) for name in joints]
    count = int(np.clip(model.coverage.n_samples, _MIN_TORQUES, _MAX_TORQUES)) // 2
    q = rng.uniform(model.coverage.q_min, model.coverage.q_max, (_DRAWN * count, model.n_joints))
    noise = np.maximum(model.noise, 1e-3 * float(model.noise.max()) + 1e-9)
    if model.covariance is not None:
        q = q[np.argsort((model.predict_std(q) / noise).max(axis=1))]
    q = np.tile(q[:count], (2, 1))
    exact, error = model.predict(q), noise * rng.standard_normal((count, model.n_joints))
    error = np.concatenate([error, -error])
    return (JointSamples.single_run(joints, np.arange(len(q)), q[:, order], np.zeros_like(q),
                                    (exact + error)[:, order]), exact[:, order], noise[order])


def _check_misfit(residual: FloatArray, noise: FloatArray, joints: tuple[str, ...]) -> None:
    """Raise ModelMismatchError if a residual (M, N) in N·m is large against its noise (N,)."""
    rms = np.sqrt((residual ** 2).mean(axis=0))
    worst = int(np.argmax(rms / noise))
    if rms[worst] > OPTIONS.max_misfit * noise[worst]:
        raise ModelMismatchError(
            f'the known axes do not reproduce the model: the torque of joint {joints[worst]} '
            f'differs by {rms[worst]:.2g} N·m within the trained range. `gravity_comp check` '
            f'names what differs: an axis, a zero angle; a per_joint model may be of no arm: '
            f'fit a chain')


def _on_chain(model: GravityModel, chain: Chain, covariance: FloatArray,
              geometry: Geometry | None) -> GravityModel:
    """Return a model with its gravity as a chain, with the joints in the order of the axes."""
    if geometry is not None and model.geometry is not None:
        # Those of the coefficients of the model's dynamics.
        geometry = replace(geometry, base=model.geometry.base)
    joints = model.joints if geometry is None else geometry.joints
    order = [model.joints.index(name) for name in joints]
    coverage = replace(model.coverage, q_min=model.coverage.q_min[order],
                       q_max=model.coverage.q_max[order])
    result = GravityModel.from_energy(
        joints, 'chain', expand(chain), model.noise[order], coverage, model.provenance, chain)
    residual = None if model.residual_std is None else model.residual_std[order]
    applied, fitted = _effects_on_axes(model)
    return replace(result, covariance=covariance, static=model.static, applied=applied,
                   history=model.history, fitted=fitted, residual_std=residual,
                   payload_path=model.payload_path, geometry=geometry)


def _effects_on_axes(model: GravityModel) -> tuple[Applied, Applied]:
    """
    Return the predicted and the fitted effects of a model whose gravity is put on known axes.

    Dynamics with lengths between axes have no coefficients there; a nominal arm replaces them.
    """
    if model.geometry is not None:
        return model.applied, model.fitted
    return model.applied.without({DYNAMICS}), model.fitted.without({DYNAMICS})
