"""
What an effect is: a torque that gravity cannot explain, linear in a few coefficients.

    tau_residual = sum_k coefficient_k column_k(q, qd, qdd, g, t; setting)

Columns are computed from the motion and from the predicted gravity torque g, never from the
measured torque: noise would otherwise explain itself. What an effect is not linear in (a
velocity, a distance, a time) is its setting, and is scanned.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
import math
from typing import get_type_hints

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.plausibility import too_much_torque
from gravity_comp_ros.errors import OptionError
import numpy as np

Setting = Mapping[str, float]


class Expectation(StrEnum):
    """How usual a torque is: it comes with motion, is common in joints, or is rare."""

    MOTION = 'motion'
    COMMON = 'common'
    RARE = 'rare'


@dataclass(frozen=True)
class Coefficient:
    """One coefficient of an effect: its symbol, unit and meaning."""

    symbol: str
    unit: str
    meaning: str


Coefficients = tuple[Coefficient, ...]


class Regressor(ABC):
    """
    Columns that may explain torque beside gravity: an effect, or a question about the residual.

    Attributes, set in the body of a class or before `Effect.__init__`:

    - `name`: what reports and model files call it.
    - `scope`: 'joint' if it acts on the torque of one joint, 'arm' if on several at once.
    - `per_joint`: whether it is about a joint, as an encoder's offset is although it acts on
      several torques. A tilted base is not: it is tried once, and the joint number that its
      methods are given means nothing.
    - `pointwise`: whether a column's value at a sample depends on that sample alone.
    - `expectation`: how usual it is, which says how much evidence it needs.
    """

    name: str
    scope: str = 'joint'
    per_joint: bool = True
    pointwise: bool = False
    expectation: Expectation = Expectation.RARE

    @abstractmethod
    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        """
        Return the torque of each coefficient where that is 1.

        (M, K) for M samples and K coefficients, or (M, N, K) of all N joints for scope 'arm'.

        :param joint: its number, from 0.
        :param setting: one of `settings` or `refine`.
        """

    def columns_of_arm(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        """Return the columns on the torque of all joints, (M, N, K), for either scope."""
        columns = self.columns(motion, joint, setting)
        if self.scope == 'arm':
            return columns
        whole = np.zeros((*motion.samples.q.shape, columns.shape[1]))
        whole[:, joint] = columns
        return whole

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return the settings worth trying on this motion; none if it cannot be judged."""
        return [{}]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        """Return finer settings around one that the scan has found; none if it is fine enough."""
        return []

    def untestable(self, motion: Motion, joint: int) -> str | None:
        """Return why this motion cannot show it, as a clause; None if it can."""
        return None


class Effect(Regressor):
    """
    A physical effect, with all that the tool says about it.

    An effect is a class with these attributes and `columns`; the other methods have defaults.
    Attributes beside those of `Regressor`:

    - `title`, `equation`, `description`, `source`: words for people. `family` is a heading.
    - `coefficients`: one for each column. Where their number depends on the arm, they show the
      kinds that occur, and `coefficients_of` returns them all.
    - `confounders`: names of effects that can look alike; `experiment` is the motion that tells
      them apart, with `{joint}` for the joint's name.
    - `signature`: over what the residual is plotted to see it.
    - `setting_units`: the unit of each number of a setting, '' for none.
    - `not_scanned`: numbers of a setting that are taken from the motion as it is, such as the
      middle of a range, so that the columns mean the same on other motions.
    - `corrects`: effects one of which must be on the joint before this one is looked for.
    - `certain`: whether every arm has the effect wherever it is testable.
    - `needs_speed`: whether it shows in fast motion, so that slow samples alone do not fit it.
    - `why_not_negative`: why no coefficient is below 0; '' if one may be.
    - `largest`: what no coefficient exceeds in size, and `why_not_larger`.

    :raises OptionError: if an attribute is missing, the scope is unknown or there is no
        coefficient.
    """

    title: str
    family: str
    equation: str
    description: str
    coefficients: Coefficients
    confounders: tuple[str, ...]
    experiment: str
    signature: str
    source: str
    setting_units: Mapping[str, str] = {}
    not_scanned: tuple[str, ...] = ()
    corrects: tuple[str, ...] = ()
    certain: bool = False
    needs_speed: bool = False
    why_not_negative: str = ''
    largest: float = math.inf
    why_not_larger: str = ''

    def __init__(self) -> None:
        missing = [word for word in ATTRIBUTES if not hasattr(self, word)]
        if missing:
            raise OptionError(f'effect {getattr(self, "name", type(self).__name__)} has no '
                              f'{", ".join(missing)}')
        if self.scope not in ('joint', 'arm'):
            raise OptionError(f'effect {self.name}: scope is {self.scope!r}; it must be '
                              f"'joint' or 'arm'")
        if not self.coefficients:
            raise OptionError(f'effect {self.name} has no coefficient')
        if not self.per_joint and self.scope == 'joint':
            raise OptionError(f"effect {self.name}: it has scope 'joint', so it is per_joint")

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        """Return one coefficient for each column that `columns` returns for the same motion."""
        return self.coefficients

    @property
    def bends_with_speed(self) -> bool:
        """Return whether it is viscous friction whose slope changes with the speed."""
        return self.signature == 'speed' and 'viscous_friction' in self.corrects

    @property
    def has_fixed_coefficients(self) -> bool:
        """Return whether the coefficients are the same for every arm and setting."""
        return getattr(self.coefficients_of, '__func__', None) is Effect.coefficients_of

    def spread(self, motion: Motion, joint: int, setting: Setting) -> FloatArray | None:
        """
        Return the standard deviations (K,) of the coefficients before any data, inf where free.

        For effects that have more coefficients than a motion may show. None leaves all free.
        """
        return None

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        """
        Return why coefficients (K,) are not physical, as a clause; None if they may be.

        By default none may be negative where `why_not_negative` says so, none exceeds `largest`,
        and together they make no more torque than there is.
        """
        values = np.asarray(values)
        least = float(values.min(initial=0.0))
        largest = float(np.abs(values).max(initial=0.0))
        if self.why_not_negative and least < 0.0:
            return f'the coefficient is negative ({least:.3g}): {self.why_not_negative}'
        if largest > self.largest:
            size = f'{largest:.3g} {self.coefficients[0].unit}'.rstrip()
            return f'{size} is too much: {self.why_not_larger}'
        return too_much_torque(self.columns(motion, joint, setting) @ values, motion, joint)

    def alternative(self) -> AlternativeModel | None:
        """Return another law by which the same cause could act, where no effect has it."""
        return None

    def n_scanned(self, setting: Setting) -> int:
        """Return how many numbers of a setting were chosen among several."""
        return sum(name not in self.not_scanned for name in setting)


# What every effect has, by name.
ATTRIBUTES = tuple(get_type_hints(Effect))


class AlternativeModel(Regressor):
    """
    Another law by which the cause of an effect could act: columns of the same shape.

    Where they explain more, the effect is not named. `meaning` says what follows instead.
    """

    meaning: str

    def __init__(self, effect: Effect) -> None:
        self.effect = effect
        self.name = f'other than {effect.name}'
        self.scope, self.per_joint, self.pointwise = (
            effect.scope, effect.per_joint, effect.pointwise)

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return those of the effect."""
        return self.effect.settings(motion, joint)

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        """Return those of the effect."""
        return self.effect.refine(motion, joint, setting)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        """Return why this motion cannot show the effect."""
        return self.effect.untestable(motion, joint)
