"""
Base class of effects: torques in addition to gravity, linear in a few coefficients.

    tau_residual = sum_k coefficient_k column_k(q, qd, qdd, g, t; setting)

Columns are computed from the motion and the predicted gravity torque g, never from the measured
torque, whose noise would be correlated with the residual. Nonlinear parameters (a speed, a
distance, a time) are called a setting; several values are compared.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
import math
from typing import get_type_hints

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.errors import ModelMismatchError, OptionError
import numpy as np

Setting = Mapping[str, float]


class Needs(StrEnum):
    """Quantities from which the torque of an effect at a moment follows."""

    SPEED = 'pose, speed and direction of motion'
    ACCELERATION = 'acceleration as well'
    HISTORY = 'time, or samples before or after'


@dataclass(frozen=True)
class Coefficient:
    """One coefficient of an effect: its symbol, unit and meaning."""

    symbol: str
    unit: str
    meaning: str


Coefficients = tuple[Coefficient, ...]


class Effect(ABC):
    """
    A physical effect with its columns, its prior and its documentation.

    An effect is a class with these attributes and `columns`; the other methods have defaults.
    Attributes, set in the body of a class or before `Effect.__init__`:

    - `name`: identifier in reports and model files.
    - `title`, `equation`, `description`, `source`: text for users. `family` is a heading.
    - `coefficients`: one for each column. If their number depends on the arm, they are examples
      of each kind, and `coefficients_of` returns all of them.
    - `confounders`: names of effects with similar torques; `experiment` is the motion that
      distinguishes them, with `{joint}` for the joint's name.
    - `signature`: quantity over which a plot of the residual shows the effect.
    - `scope`: 'joint' if it acts on the torque of one joint, 'arm' if on several joints.
    - `per_joint`: whether it belongs to a joint. An encoder offset does, although it acts on
      several torques. A base tilt does not: it is tested once, and its methods ignore the joint
      number.
    - `is_common`: whether joints have it as often as not; other effects are rare (`log_odds`).
    - `is_static`: whether it holds the arm at rest, as gravity does.
    - `resembles_gravity`: whether it depends on the pose as gravity may, so that little motion
      does not separate both.
    - `needs`: what its torque at a moment depends on. One that does not need the history is
      computed in a control loop, from a motion of one sample.
    - `uses_gravity`: whether its columns depend on the gravity model; if not, they are computed
      once.
    - `is_shared`: whether every fit estimates it as a part of the shared columns, so that it is
      not selected.
    - `setting_units`: the unit of each nonlinear parameter, '' for none.
    - `discrete`: nonlinear parameters with separate values, which refinement does not change.
    - `common`: nonlinear parameters that all effects of a joint have in common, such as the law
      of the direction of its motion.
    - `corrects`: effects of which the joint must have one, because this one corrects it.
    - `size`: prior RMS of its torque, as a share of the joint's torque scale; or `shares`: the
      prior standard deviations of the coefficients over that scale, one for all or one for each;
      or `std`: that of each coefficient, in its unit.
    - `why_not_negative`: why the coefficients of `positive` are not negative; '' if all can be.
    - `largest`: maximum absolute value of a coefficient; `why_not_larger` is the reason.

    :raises OptionError: if an attribute is missing, the scope is unknown or there is no
        coefficient.
    """

    name: str
    title: str
    family: str
    equation: str
    description: str
    coefficients: Coefficients
    confounders: tuple[str, ...]
    experiment: str
    signature: str
    source: str
    scope: str = 'joint'
    per_joint: bool = True
    is_common: bool = False
    is_static: bool = False
    resembles_gravity: bool = False
    needs: Needs = Needs.HISTORY
    uses_gravity: bool = True
    is_shared: bool = False
    setting_units: Mapping[str, str] = {}
    discrete: tuple[str, ...] = ()
    common: tuple[str, ...] = ()
    corrects: tuple[str, ...] = ()
    size: float = 0.1
    shares: tuple[float, ...] = ()
    std: float = 0.0
    why_not_negative: str = ''
    largest: float = math.inf
    why_not_larger: str = ''

    def __init__(self) -> None:
        missing = [word for word in get_type_hints(Effect) if not hasattr(self, word)]
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

    @abstractmethod
    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        """
        Return the torque in N·m per unit of each coefficient.

        (M, K) for M samples and K coefficients, or (M, N, K) of all N joints for scope 'arm'.

        :param joint: its number, from 0.
        :param setting: an element of `settings` or `refine`.
        """

    def torque(self, motion: Motion, joint: int, setting: Setting,
               values: FloatArray) -> FloatArray:
        """
        Return the torque in N·m with coefficients (K,): (M,), or (M, N) for scope 'arm'.

        :raises ModelMismatchError: if there are more or fewer columns.
        """
        columns = self.columns(motion, joint, setting)
        if columns.shape[-1] != len(values):
            raise ModelMismatchError(f'effect {self.name} has {columns.shape[-1]} columns and '
                                     f'{len(values)} coefficients. Remove it and add it again')
        return np.asarray(columns @ values)

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return the settings to compare on this motion; none if it is not testable."""
        return [{}]

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        """
        Return neighbours of a setting, to refine it; none if no refinement is needed.

        :param step: distance of the neighbours, 1 for the first refinement and less later.
        """
        return []

    def untestable(self, motion: Motion, joint: int) -> str | None:
        """Return why this motion does not excite it, as a clause; None if it does."""
        return None

    @property
    def log_odds(self) -> float:
        """Return the prior log odds that a joint has it: even, or 1 to 55."""
        return 0.0 if self.is_common else -4.0

    def prior_std(self, torque: float, columns: FloatArray) -> FloatArray:
        """
        Return the prior standard deviations (K,) of the coefficients about 0.

        :param torque: scale of the joint's torque, N·m.
        :param columns: RMS of the columns (K,).
        """
        if self.std:
            return np.full(len(columns), self.std)
        if self.shares:
            return np.full(len(columns), torque) * self.shares
        return np.asarray(self.size * torque / np.maximum(columns, 1e-9))

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        """Return one coefficient for each column that `columns` returns for the same motion."""
        return self.coefficients

    def positive(self, setting: Setting, count: int) -> BoolArray:
        """Return a mask (K,) of the coefficients that cannot be negative, all by default."""
        return np.full(count, bool(self.why_not_negative))

    @property
    def has_limits(self) -> bool:
        """Return whether `implausible` checks more than signs."""
        return self.largest < math.inf or type(self).implausible is not Effect.implausible

    def implausible(self, values: FloatArray, setting: Setting) -> str | None:
        """
        Return why coefficients (K,) are not physical, as a clause; None if they are plausible.

        An implausible effect is not added, and the share of its posterior that is implausible
        counts against it as an alternative. The default checks the signs and the limit `largest`.
        """
        values = np.asarray(values)
        minimum = float(values[self.positive(setting, len(values))].min(initial=0.0))
        largest = float(np.abs(values).max(initial=0.0))
        if minimum < 0.0:
            return f'the coefficient is negative ({minimum:.3g}): {self.why_not_negative}'
        if largest > self.largest:
            size = f'{largest:.3g} {self.coefficients[0].unit}'.rstrip()
            return f'{size} is too large: {self.why_not_larger}'
        return None
