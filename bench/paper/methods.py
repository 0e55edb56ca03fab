"""The formulations of this package, as the bench calls them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
import time

from bench.paper.scenes import FloatArray, Scene
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.urdf import read_urdf
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.estimation.fit_with_effects import fit_with_effects
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
import numpy as np

URDF = Path(__file__).resolve().parents[2] / 'bags' / 'iiwa7.urdf'


@dataclass(frozen=True)
class Fitted:
    """
    What a method learned.

    `features` counts the numbers that each joint's torque is made of (for a kernel, its support
    vectors), None where nothing was fitted; `n_samples` is what it was learned from.
    """

    predict: Callable[[FloatArray], FloatArray]
    features: list[int] | None
    n_samples: int
    seconds: float


Method = Callable[[Scene], Fitted]
_KNOWN: dict[tuple[bytes, str, bool, bool], GravityModel] = {}


def formulation(name: str, friction: bool = False) -> Method:
    """Return the fit of a formulation, with Coulomb friction as an effect if wanted."""
    def method(scene: Scene) -> Fitted:
        start = time.perf_counter()
        model = _learned(scene.train, FitOptions(name), friction)
        return _fitted(model, scene.train.n_samples, start)
    return method


def updated(urdf: bool) -> Method:
    """Return the update of a chain from the first seconds with a payload."""
    def method(scene: Scene) -> Fitted:
        assert scene.before is not None and scene.few is not None
        geometry = read_urdf(URDF, scene.before.names) if urdf else None
        old = _before(scene, geometry)
        start = time.perf_counter()
        gravity = JointSamples.single_run(
            scene.few.names, scene.few.t, scene.few.q, scene.few.qd,
            scene.few.tau - effect_torque(old, scene.few))
        model = update(old, gravity, geometry=geometry).model
        return _fitted(model, scene.few.n_samples, start)
    return method


def stale(scene: Scene) -> Fitted:
    """Return the chain of the arm before it had its payload."""
    model = _before(scene)
    return Fitted(model.predict, model.n_features().tolist(), 0, 0.0)


def _before(scene: Scene, geometry: Geometry | None = None) -> GravityModel:
    """Return the chain of the arm before its payload."""
    assert scene.before is not None
    return _learned(scene.before, FitOptions('chain', geometry=geometry), friction=True)


def _learned(samples: JointSamples, options: FitOptions, friction: bool) -> GravityModel:
    """Return a model, with friction if wanted; several methods and figures start from the same."""
    key = samples.tau.tobytes(), options.formulation, options.geometry is not None, friction
    if key not in _KNOWN:
        wanted = requests(['coulomb_friction'], samples.names)
        _KNOWN[key] = (fit_with_effects(samples, samples, wanted, options).joint.model
                       if friction else fit(samples, options).model)
    return _KNOWN[key]


def _fitted(model: GravityModel, count: int, start: float) -> Fitted:
    seconds = time.perf_counter() - start
    return Fitted(model.predict, np.asarray(model.n_features()).tolist(), count, seconds)
