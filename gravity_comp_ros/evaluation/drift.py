"""
Drift between two models of one arm: changes since the earlier one was fitted.

Compared are the torque of gravity and all static effects at the same poses, with the standard
deviations of both models, and the coefficients of the effects of single joints. A motion that does
not separate gravity from a spring determines their sum. With other nonlinear parameters (the
centre of a spring, the recordings of an offset) a coefficient has another meaning and is not
compared; the law of the direction of motion leaves it as it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion_direction import LAW_UNITS
from gravity_comp_ros.effects.predict import static_std, static_torque
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.evaluation.compare import COMPARISON
from gravity_comp_ros.models.applied_effects import AppliedEffect, Quantity
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np


@dataclass(frozen=True)
class JointDrift:
    """
    Change of the static torque of a joint: RMS over the poses, and its mean, in N·m.

    `std` is its standard deviation in N·m, RMS over the poses, None for models without one.
    `unknown` is True if there is none, or if a change that is not significant exceeds the noise:
    the models are too uncertain to exclude it.
    """

    rms: float
    mean: float
    std: float | None
    drifted: bool
    unknown: bool


@dataclass(frozen=True)
class CoefficientDrift:
    """A coefficient of an effect in both models; None where a model has not found it."""

    target: str
    symbol: str
    before: Quantity | None
    after: Quantity | None
    drifted: bool


@dataclass(frozen=True)
class Drift:
    """The drift of every joint, and of the coefficients of their effects."""

    joints: Mapping[str, JointDrift]
    coefficients: tuple[CoefficientDrift, ...]


def drift(before: GravityModel, after: GravityModel, samples: JointSamples) -> Drift:
    """
    Return the changes from one model to another at the poses of samples.

    :raises ModelMismatchError: if the models have different joints.
    """
    if before.joints != after.joints:
        raise ModelMismatchError(f'the models have different joints: {", ".join(before.joints)} '
                                 f'and {", ".join(after.joints)}')
    still = JointSamples.at_rest(after.joints, samples.joints(after.joints).q)
    change = static_torque(after, still) - static_torque(before, still)
    std, joints = _std((before, after), still.q), {}
    noise = np.hypot(before.noise_with_nuisance, after.noise_with_nuisance)
    for k, name in enumerate(after.joints):
        rms = float(np.sqrt((change[:, k] ** 2).mean()))
        error = None if std is None else float(std[k])
        drifted = error is not None and rms > COMPARISON.significance * error
        joints[name] = JointDrift(
            rms, float(change[:, k].mean()), error, drifted,
            not drifted and (error is None or rms > COMPARISON.significance * float(noise[k])))
    return Drift(joints, tuple(_coefficients(before, after)))


def _std(models: Iterable[GravityModel], q: FloatArray) -> FloatArray | None:
    """Return the RMS standard deviation (N,) of the change in N·m, None if it is unknown."""
    try:
        variance = [static_std(model, q, (*model.applied.effects, *model.fitted.effects)) ** 2
                    for model in models]
    except DataError:
        return None
    return np.asarray(np.sqrt(np.sum(variance, axis=0).mean(axis=0)))


def _coefficients(before: GravityModel, after: GravityModel) -> Iterator[CoefficientDrift]:
    """Yield the comparable coefficients of effects of single joints, in their order."""
    old, new = _effects(before), _effects(after)
    for key in sorted({**old, **new}, key=lambda key: (after.joints.index(key[1]), key[0])):
        effects = [model[key] for model in (old, new) if key in model]
        if _parameters(effects[0]) != _parameters(effects[-1]):
            continue
        for symbol in dict.fromkeys(symbol for each in effects for symbol in each.coefficients):
            x, y = (model[key].coefficients.get(symbol) if key in model else None
                    for model in (old, new))
            yield CoefficientDrift(effects[0].target, symbol, x, y, _has_drifted(x, y))


def _parameters(effect: AppliedEffect) -> dict[str, float]:
    """Return the nonlinear parameters of an effect without the law of its direction."""
    return {name: x for name, x in effect.setting.items() if name not in LAW_UNITS}


def _effects(model: GravityModel) -> dict[tuple[str, str], AppliedEffect]:
    return {(effect.name, effect.joint): effect
            for effect in (*model.fitted.effects, *model.applied.effects)
            if effect.joint is not None}


def _has_drifted(before: Quantity | None, after: Quantity | None) -> bool:
    """Return whether two coefficients differ; one that was not found counts as 0."""
    values = [0.0 if x is None else x.value for x in (before, after)]
    halves = [x.half for x in (before, after) if x is not None]
    return bool(abs(values[1] - values[0])
                > COMPARISON.significance / HALF_95 * float(np.linalg.norm(halves)))
