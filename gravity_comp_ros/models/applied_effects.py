"""
Effects of a model in addition to gravity.

Data only: reading a model file must not require the library of effects, which computes torques.
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
    One effect in a model: its joint (None: the whole arm), and its coefficients by symbol.

    `setting` are its nonlinear parameters, such as a Stribeck speed.

    :raises DataError: if there is no coefficient, or a nonlinear parameter is not finite.
    """

    name: str
    joint: str | None
    setting: Mapping[str, float]
    coefficients: Mapping[str, Value]

    def __post_init__(self) -> None:
        if not self.coefficients:
            raise DataError(f'effect {self.name} has no coefficient')
        if not np.isfinite([float(x) for x in self.setting.values()]).all():
            raise DataError(f'effect {self.name}: a nonlinear parameter is not finite')

    @property
    def target(self) -> str:
        """Return `NAME:JOINT`, or `NAME` for the whole arm: the argument of `add`."""
        return target(self.name, self.joint)


def target(name: str, joint: str | None) -> str:
    """Return `NAME:JOINT`, or `NAME` for the whole arm."""
    return name if joint is None else f'{name}:{joint}'


@dataclass(frozen=True, eq=False)
class Applied:
    """
    All effects of a model.

    `direction` are the parameters of the direction of motion in the fitted data, by name, (N,)
    each. `width` in rad/s, the speed over which friction changes sign, is always among them.

    :raises DataError: if effects come without these parameters, one is not finite or negative, or
        an effect is given twice.
    """

    effects: tuple[AppliedEffect, ...] = ()
    direction: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        arrays = {name: np.asarray(x, dtype=np.float64) for name, x in self.direction.items()}
        for name, array in arrays.items():
            if array.ndim != 1 or not np.isfinite(array).all() or (array < 0.0).any():
                raise DataError(f'effects: a {name} of the direction is negative or not finite')
        object.__setattr__(self, 'direction', arrays)
        if self.effects and not (arrays.get('width', np.zeros(1)) > 0.0).all():
            raise DataError('effects: the width of the direction is missing')
        targets = [effect.target for effect in self.effects]
        if len(set(targets)) < len(targets):
            raise DataError(f'effects: one is given twice among {", ".join(targets)}')

    def has(self, name: str, joint: str | None) -> bool:
        """Return whether the model has this effect."""
        return any((e.name, e.joint) == (name, joint) for e in self.effects)
