"""
Effects that a model has been given besides gravity, and how they and payloads came and went.

Pure data: what the torque of an effect is stands in the library of effects, which a model file
must not need in order to be read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from gravity_comp_ros.errors import DataError
from gravity_comp_ros.samples import FloatArray
import numpy as np

if TYPE_CHECKING:
    from gravity_comp_ros.gravity.model import GravityModel

ADDED, REMOVED, UPDATED = 'added', 'removed', 'updated'


@dataclass(frozen=True)
class Value:
    """
    A coefficient's value in its `unit`, with its 95 % interval.

    :raises DataError: if a number is not finite.
    """

    value: float
    unit: str
    ci95: tuple[float, float]

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


@dataclass(frozen=True)
class Step:
    """
    One change of a model.

    `action` is 'added' or 'removed' for effects, 'updated' for a payload; `effects` are their
    targets (`payload` of an update), `when` a time as text (from
    whoever asked for the change). `before` and `after` are held-out RMSE by joint in N·m,
    empty where nothing was measured. `previous` is the model to go back to, None once that
    has happened.
    """

    action: str
    effects: tuple[str, ...]
    when: str
    before: Mapping[str, float] = field(default_factory=dict)
    after: Mapping[str, float] = field(default_factory=dict)
    previous: GravityModel | None = None

    def __post_init__(self) -> None:
        if self.action not in (ADDED, REMOVED, UPDATED):
            raise DataError(f'history: unknown step {self.action!r}')


@dataclass(frozen=True)
class Applied:
    """
    All effects of a model, and their history, the latest step last.

    `direction` says how the direction of motion of each joint was told in the data that the
    coefficients were fitted to, as numbers by name, one (N,) per joint; `width` in rad/s, the
    speed over which friction turns its sign, is always among them.

    :raises DataError: if there are effects without such numbers, one is not finite or
        negative, or an effect is there twice.
    """

    effects: tuple[AppliedEffect, ...] = ()
    direction: Mapping[str, FloatArray] = field(default_factory=dict)
    history: tuple[Step, ...] = ()

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


def with_step(model: GravityModel, previous: GravityModel, effects: tuple[str, ...], when: str,
              before: Mapping[str, float], after: Mapping[str, float],
              action: str = ADDED) -> GravityModel:
    """Return a model with the step that led to it from the `previous` one in its history."""
    # Each step holds one model, not the histories of those before it over again.
    bare = replace(previous, applied=replace(previous.applied, history=()))
    step = Step(action, effects, when, before, after, bare)
    history = (*previous.applied.history, step)
    return replace(model, applied=replace(model.applied, history=history))


def undone(model: GravityModel, when: str) -> GravityModel:
    """
    Return the model as it was before the last addition or update; the history tells of both.

    :raises DataError: if nothing was added, all of it is undone, or the model before it does not
        know of a payload that came since.
    """
    history = model.applied.history
    place = next((k for k in reversed(range(len(history))) if history[k].previous), None)
    if place is None:
        raise DataError('there is no addition to take back' + (
            '; it was taken back already' if history else ''))
    step, previous = history[place], history[place].previous
    assert previous is not None
    if step.action == ADDED and _updates(previous) != _updates(model):
        raise DataError(f'the payload changed after {", ".join(step.effects)} had been added, and '
                        f'the model before that does not know it; fit again without the effect')
    kept = (*history[:place], replace(step, previous=None), *history[place + 1:])
    back = Step(REMOVED, step.effects, when, step.after, step.before)
    return replace(previous, applied=replace(previous.applied, history=(*kept, back)))


def _updates(model: GravityModel) -> int:
    return len(model.provenance.get('updates', ()))
