"""Methods of this package: fits of each formulation, updates, and the stale model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
import time

from bench.paper.scenes import FloatArray, Scene
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.urdf import parse_urdf
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.effects.request import requests
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
        geometry = parse_urdf(URDF.read_bytes(), samples.names) if urdf else None
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
    """Return a fit from the cache, since several methods and figures use the same one."""
    key = samples.tau.tobytes(), options.formulation, options.geometry is not None, friction
    if key not in _CACHE:
        effects = requests(['coulomb_friction'] if friction else [], samples.names)
        _CACHE[key] = fit(samples, options, effects=effects).model
    return _CACHE[key]


def _fitted(model: GravityModel, count: int, start: float) -> Fitted:
    seconds = time.process_time() - start
    return Fitted(model.predict, np.asarray(model.n_features()).tolist(), count, seconds)
