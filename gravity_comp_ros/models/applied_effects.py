"""
Effects of a model in addition to gravity.

Data only: reading a model file must not require the library of effects, which computes torques.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Self

from gravity_comp_ros.errors import DataError
import numpy as np


@dataclass(frozen=True)
class Quantity:
    """A number in its `unit`, with its 95 % interval."""

    value: float
    unit: str
    ci95: tuple[float, float]

    @classmethod
    def around(cls, value: float, unit: str, half: float) -> Self:
        """Return a quantity whose interval reaches `half` of its width to both sides."""
        return cls(float(value), unit, (float(value - half), float(value + half)))

    @property
    def half(self) -> float:
        """Return half the width of the interval."""
        return 0.5 * (self.ci95[1] - self.ci95[0])

    def times(self, factor: float) -> Self:
        """Return the quantity times a number of either sign."""
        low, high = sorted(factor * x for x in self.ci95)
        return replace(self, value=factor * self.value, ci95=(low, high))


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
    A set of effects of a model.

    :raises DataError: if an effect is given twice.
    """

    effects: tuple[AppliedEffect, ...] = ()

    def __post_init__(self) -> None:
        targets = [effect.target for effect in self.effects]
        if len(set(targets)) < len(targets):
            raise DataError(f'effects: one is given twice among {", ".join(targets)}')

    def without(self, targets: Collection[str]) -> Applied:
        """Return the set without some targets."""
        return Applied(tuple(e for e in self.effects if e.target not in targets))

    def has(self, name: str, joint: str | None) -> bool:
        """Return whether the model has this effect."""
        return any((e.name, e.joint) == (name, joint) for e in self.effects)
