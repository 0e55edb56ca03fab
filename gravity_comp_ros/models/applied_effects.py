"""
Effects that a model has been given besides gravity.

Pure data: what the torque of an effect is stands in the library of effects, which a model file
must not need in order to be read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
import numpy as np


@dataclass(frozen=True)
class Quantity:
    """A number in its `unit`, with its 95 % interval."""

    value: float
    unit: str
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Value(Quantity):
    """
    The quantity of a coefficient.

    :raises DataError: if a number is not finite.
    """

    def __post_init__(self) -> None:
        if not np.isfinite([self.value, *self.ci95]).all() or len(self.ci95) != 2:
            raise DataError('effect: a coefficient is not finite')


@dataclass(frozen=True)
class AppliedEffect:
    """
    One effect in a model: on which joint (None: the whole arm), and its numbers by symbol.

    `setting` holds what the effect is not linear in, such as a Stribeck speed.

    :raises DataError: if there is no coefficient, or a setting is not finite.
    """

    name: str
    joint: str | None
    setting: Mapping[str, float]
    coefficients: Mapping[str, Value]

    def __post_init__(self) -> None:
        if not self.coefficients:
            raise DataError(f'effect {self.name} has no coefficient')
        if not np.isfinite([float(x) for x in self.setting.values()]).all():
            raise DataError(f'effect {self.name}: a setting is not finite')

    @property
    def target(self) -> str:
        """Return `NAME:JOINT`, or `NAME` for the whole arm, as `add` takes it."""
        return target(self.name, self.joint)


def target(name: str, joint: str | None) -> str:
    """Return `NAME:JOINT`, or `NAME` for the whole arm."""
    return name if joint is None else f'{name}:{joint}'


@dataclass(frozen=True, eq=False)
class Applied:
    """
    All effects of a model.

    `direction` says how the direction of motion of each joint was told in the data that the
    coefficients were fitted to, as numbers by name, one (N,) per joint; `width` in rad/s, the
    speed over which friction turns its sign, is always among them.

    :raises DataError: if there are effects without such numbers, one is not finite or
        negative, or an effect is there twice.
    """

    effects: tuple[AppliedEffect, ...] = ()
    direction: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        told = {name: np.asarray(x, dtype=np.float64) for name, x in self.direction.items()}
        for name, numbers in told.items():
            if numbers.ndim != 1 or not np.isfinite(numbers).all() or (numbers < 0.0).any():
                raise DataError(f'effects: a {name} of the direction is negative or no number')
        object.__setattr__(self, 'direction', told)
        if self.effects and not (told.get('width', np.zeros(1)) > 0.0).all():
            raise DataError('effects: they come without the width of the direction')
        targets = [effect.target for effect in self.effects]
        if len(set(targets)) < len(targets):
            raise DataError(f'effects: one is there twice among {", ".join(targets)}')

    def has(self, name: str, joint: str | None) -> bool:
        """Return whether this effect is there."""
        return any((e.name, e.joint) == (name, joint) for e in self.effects)
