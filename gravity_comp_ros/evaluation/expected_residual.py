"""
Residual that is expected of a model: its noise, and the size of its friction.

A fit estimates friction, offset, inertia and other effects jointly with gravity, and the model
does not predict them (`GravityModel.fitted`). The noise is that of the residual without them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.runs import MAX_PAUSE
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.predict import torque_of
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

# Family of the effects that are friction.
FRICTION = 'friction'


@dataclass(frozen=True)
class ResidualOptions:
    """
    Constants of the expected residual.

    - `drift`: relative change of friction with temperature and load.
    - `min_noise`: minimum noise of a joint as a share of the largest; a joint without gravity has
      almost none.
    - `speed`, rad/s: of the motion that measures the size of an effect, in `steps` through the
      trained range.
    - `seconds`: durations of that motion; the larger size counts. Effects that depend on earlier
      samples act in a short one, warming and drift after hours: those of the longest pause in a
      session, in which an arm cools down.
    - `slow`: low speeds, relative to the width of a law of direction; at twice its width it has
      0.96 of its friction.

    :raises OptionError: if a number is not positive.
    """

    drift: float = 0.3
    min_noise: float = 0.05
    speed: float = 0.1
    steps: int = 20
    seconds: tuple[float, ...] = (20.0, MAX_PAUSE)
    slow: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0)

    def __post_init__(self) -> None:
        check_positive(self, 'expected residual')


RESIDUAL = ResidualOptions()


@lru_cache(maxsize=8)
def residual_noise(model: GravityModel) -> FloatArray:
    """Return the standard deviation (N,), N·m, of the residual without friction and offset."""
    noise = model.noise_with_nuisance
    return np.maximum(noise, RESIDUAL.min_noise * float(noise.max()) + 1e-9)


@lru_cache(maxsize=8)
def expected_residual(model: GravityModel) -> FloatArray:
    """Return the standard deviation (N,), N·m, of that residual plus the drift of friction."""
    return np.hypot(residual_noise(model), RESIDUAL.drift * friction_size(model))


@lru_cache(maxsize=8)
def friction_size(model: GravityModel) -> FloatArray:
    """Return the `size` (N,) in N·m of the friction of a model."""
    known = {name for name, effect in all_effects().items() if effect.family == FRICTION}
    return size(model, [effect for effect in (*model.applied.effects, *model.fitted.effects)
                        if effect.name in known])


def size(model: GravityModel, effects: Iterable[AppliedEffect],
         speed: float | FloatArray = RESIDUAL.speed) -> FloatArray:
    """
    Return the RMS torque (N,) in N·m of effects in a motion through the trained range.

    :param speed: of all joints, or (N,), rad/s.
    """
    coverage, share = model.coverage, np.linspace(0.0, 1.0, 1 + RESIDUAL.steps)
    q = coverage.q_min + share[:, None] * (coverage.q_max - coverage.q_min)
    rest, effects = np.zeros_like(q), tuple(effects)
    sweeps = [JointSamples.single_run(model.joints, share * seconds, q, rest + speed, rest)
              for seconds in RESIDUAL.seconds]
    # The first sample has no direction yet where friction depends on the path.
    return np.asarray(np.max([rms(torque_of(model, effects, sweep)[1:]) for sweep in sweeps],
                             axis=0))


def static_limit(model: GravityModel, friction: Iterable[AppliedEffect],
                 slow: FloatArray) -> FloatArray:
    """
    Return the largest friction (N,) in N·m at low speed, which a joint at rest may have.

    :param slow: (N,) the speed in rad/s at which friction has its direction.
    """
    effects = tuple(friction)
    return np.asarray(np.max([size(model, effects, share * slow) for share in RESIDUAL.slow],
                             axis=0))


def rms(values: FloatArray) -> FloatArray:
    """Return the root mean square of values (M, ...) over the first axis."""
    return np.sqrt(np.mean(np.square(values), axis=0))
