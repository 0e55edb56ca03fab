"""Methods of this package, and errors of a method on a scene with their maximum over seeds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
import time

from bench.paper.scenes import FloatArray, Scene
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.effects.registry import requests
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
import numpy as np

URDF = Path(__file__).resolve().parents[2] / 'bags' / 'iiwa7.urdf'


@dataclass(frozen=True)
class Fitted:
    """
    Result of a method.

    `features` is the number of features of each joint's torque (of a kernel method, its support
    vectors), None without a fit. `n_samples` is the number of training samples.
    """

    predict: Callable[[FloatArray], FloatArray]
    features: list[int] | None
    n_samples: int
    seconds: float


Method = Callable[[Scene], Fitted]
_CACHE: dict[tuple[bytes, str, bool, bool], GravityModel] = {}


def formulation(name: str, friction: bool = False) -> Method:
    """Return the fit of a formulation, optionally with Coulomb friction as an effect."""
    def method(scene: Scene) -> Fitted:
        start = time.process_time()
        model = _learned(scene.train, FitOptions(name), friction)
        return _fitted(model, scene.train.n_samples, start)
    return method


def updated(urdf: bool) -> Method:
    """Return the update of a chain from the first seconds with a payload."""
    def method(scene: Scene) -> Fitted:
        samples = scene.first_loaded
        assert scene.unloaded is not None and samples is not None
        geometry = None
        if urdf:  # its axes without its masses
            geometry = replace(described_arm(URDF.read_bytes(), samples.names).geometry,
                               inertials=np.zeros((0, 10)))
        old = _unloaded_chain(scene, geometry)
        start = time.process_time()
        gravity = JointSamples.single_run(samples.names, samples.t, samples.q, samples.qd,
                                          samples.tau - effect_torque(old, samples))
        model = update(old, gravity, geometry=geometry).model
        return _fitted(model, samples.n_samples, start)
    return method


def stale(scene: Scene) -> Fitted:
    """Return the chain of the arm without its payload."""
    model = _unloaded_chain(scene)
    return Fitted(model.predict, model.n_features().tolist(), 0, 0.0)


def _unloaded_chain(scene: Scene, geometry: Geometry | None = None) -> GravityModel:
    assert scene.unloaded is not None
    return _learned(scene.unloaded, FitOptions('chain', geometry=geometry), friction=True)


def _learned(samples: JointSamples, options: FitOptions, friction: bool) -> GravityModel:
    """Return a fit from the cache, since several methods use the same one."""
    key = samples.tau.tobytes(), options.formulation, options.geometry is not None, friction
    if key not in _CACHE:
        effects = requests(['coulomb_friction'] if friction else [], samples.names)
        _CACHE[key] = fit(samples, options, effects=effects).model
    return _CACHE[key]


def _fitted(model: GravityModel, count: int, start: float) -> Fitted:
    seconds = time.process_time() - start
    return Fitted(model.predict, np.asarray(model.n_features()).tolist(), count, seconds)


@dataclass(frozen=True)
class Row:
    """
    Errors of one method by joint (N,) in N·m, and relative to the torque's range (Eq. (16)).

    `measured` is relative to the measured torque, with friction and noise; `inside` and `anywhere`
    are relative to exact gravity, in the trained range and over all joint limits.
    """

    name: str
    n_samples: int
    features: list[int] | None
    seconds: float
    measured: FloatArray
    nrmse: FloatArray
    inside: FloatArray
    nrmse_inside: FloatArray
    anywhere: FloatArray
    nrmse_anywhere: FloatArray


def score(name: str, method: Method, scene: Scene) -> Row:
    """Fit a method to a scene and return its errors."""
    fitted = method(scene)
    predicted = fitted.predict(scene.inside.q)
    measured, nrmse = _errors(predicted, scene.inside.measured)
    inside, nrmse_inside = _errors(predicted, scene.inside.truth)
    anywhere, nrmse_anywhere = _errors(fitted.predict(scene.anywhere.q), scene.anywhere.truth)
    return Row(name, fitted.n_samples, fitted.features, fitted.seconds, measured, nrmse, inside,
               nrmse_inside, anywhere, nrmse_anywhere)


def worst(rows: list[Row]) -> Row:
    """Return the maximum of every figure over seeds."""
    first = rows[0]
    features = None if first.features is None else np.max(
        [row.features for row in rows], axis=0).tolist()

    def largest(key: str) -> FloatArray:
        return np.max([getattr(row, key) for row in rows], axis=0)
    return Row(first.name, first.n_samples, features, max(row.seconds for row in rows),
               *(largest(key) for key in ('measured', 'nrmse', 'inside', 'nrmse_inside',
                                          'anywhere', 'nrmse_anywhere')))


def _errors(predicted: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    rmse = np.sqrt(((predicted - target) ** 2).mean(axis=0))
    spread = np.ptp(target, axis=0)
    # nRMSE is undefined for a joint without gravity torque.
    return rmse, np.where(spread > 1e-3, rmse / np.maximum(spread, 1e-3), np.nan)
