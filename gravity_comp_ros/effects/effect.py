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

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.errors import OptionError
import numpy as np

Setting = Mapping[str, float]
# Maximum torque of an effect, relative to the largest measured torque; larger torques cancel each
# other.
_MAX_RATIO = 1.5


class Expectation(StrEnum):
    """Prior expectation of a torque: dynamics of every motion, common in joints, or rare."""

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
    Columns that explain torque in addition to gravity: an effect, or a test of the residual.

    Attributes, set in the body of a class or before `Effect.__init__`:

    - `name`: identifier in reports and model files.
    - `scope`: 'joint' if it acts on the torque of one joint, 'arm' if on several joints.
    - `per_joint`: whether it belongs to a joint. An encoder offset does, although it acts on
      several torques. A base tilt does not: it is tested once, and its methods ignore the joint
      number.
    - `pointwise`: whether a column's value at a sample depends on that sample alone.
    - `expectation`: prior expectation, which determines the evidence required.
    """

    name: str
    scope: str = 'joint'
    per_joint: bool = True
    pointwise: bool = False
    expectation: Expectation = Expectation.RARE

    @abstractmethod
    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        """
        Return the torque in N·m per unit of each coefficient.

        (M, K) for M samples and K coefficients, or (M, N, K) of all N joints for scope 'arm'.

        :param joint: its number, from 0.
        :param setting: an element of `settings` or `refine`.
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
        """Return the settings to compare on this motion; none if it is not testable."""
        return [{}]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        """Return finer settings around one of the best; none if no refinement is needed."""
        return []

    def untestable(self, motion: Motion, joint: int) -> str | None:
        """Return why this motion does not excite it, as a clause; None if it does."""
        return None


class Effect(Regressor):
    """
    A physical effect with its documentation.

    An effect is a class with these attributes and `columns`; the other methods have defaults.
    Attributes in addition to those of `Regressor`:

    - `title`, `equation`, `description`, `source`: text for users. `family` is a heading.
    - `coefficients`: one for each column. If their number depends on the arm, they are examples
      of each kind, and `coefficients_of` returns all of them.
    - `confounders`: names of effects with similar torques; `experiment` is the motion that
      distinguishes them, with `{joint}` for the joint's name.
    - `signature`: quantity over which a plot of the residual shows the effect.
    - `setting_units`: the unit of each nonlinear parameter, '' for none.
    - `not_scanned`: parameters that are computed from the motion, such as the centre of a range,
      and stored so that the columns have the same meaning on other motions.
    - `corrects`: effects of which one must be chosen on the joint before this one is tested.
    - `certain`: whether every arm has the effect wherever it is testable.
    - `needs_speed`: whether its identification requires fast motion.
    - `why_not_negative`: why no coefficient is negative; '' if coefficients can be negative.
    - `largest`: maximum absolute value of a coefficient; `why_not_larger` is the reason.

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
    def is_nonlinear_in_speed(self) -> bool:
        """Return whether it is a friction law that is nonlinear in speed."""
        return self.signature == 'speed' and 'viscous_friction' in self.corrects

    @property
    def has_fixed_coefficients(self) -> bool:
        """Return whether the coefficients are the same for every arm and setting."""
        return getattr(self.coefficients_of, '__func__', None) is Effect.coefficients_of

    def spread(self, motion: Motion, joint: int, setting: Setting) -> FloatArray | None:
        """
        Return the prior standard deviations (K,) of the coefficients, inf where free.

        For effects with more coefficients than a motion can identify; None for no prior.
        """
        return None

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        """
        Return why coefficients (K,) are not physical, as a clause; None if they are plausible.

        The default checks the sign if `why_not_negative` is set, the limit `largest`, and that
        their torque does not exceed the measured one.
        """
        values = np.asarray(values)
        minimum = float(values.min(initial=0.0))
        largest = float(np.abs(values).max(initial=0.0))
        if self.why_not_negative and minimum < 0.0:
            return f'the coefficient is negative ({minimum:.3g}): {self.why_not_negative}'
        if largest > self.largest:
            size = f'{largest:.3g} {self.coefficients[0].unit}'.rstrip()
            return f'{size} is too large: {self.why_not_larger}'
        return too_much_torque(self.columns(motion, joint, setting) @ values, motion, joint)

    def alternative(self) -> AlternativeModel | None:
        """Return another model of the same physical cause, if there is one."""
        return None

    def n_scanned(self, setting: Setting) -> int:
        """Return the number of nonlinear parameters of a setting that were compared."""
        return sum(name not in self.not_scanned for name in setting)


def too_much_torque(torque: FloatArray, motion: Motion, joint: int) -> str | None:
    """Return the reason if a torque (M,) of the joint, or (M, N), exceeds the measured one."""
    measured = np.abs(motion.samples.tau)
    if torque.ndim == 1:
        measured = measured[:, joint]
    peak = float(np.abs(torque).max(initial=0.0))
    limit = float(measured.max(initial=0.0))
    if peak > _MAX_RATIO * limit:
        return f'its torque is up to {peak:.3g} N·m, the measured torque at most {limit:.3g} N·m'
    return None


# Names of the attributes of every effect.
ATTRIBUTES = tuple(get_type_hints(Effect))


class AlternativeModel(Regressor):
    """
    Alternative model of the cause of an effect: columns of the same shape.

    If they explain more, the effect is not named. `meaning` describes the alternative.
    """

    meaning: str

    def __init__(self, effect: Effect) -> None:
        self.effect = effect
        self.name = f'other than {effect.name}'
        self.scope, self.per_joint, self.pointwise = (
            effect.scope, effect.per_joint, effect.pointwise)

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return the settings of the effect."""
        return self.effect.settings(motion, joint)

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        """Return the refined settings of the effect."""
        return self.effect.refine(motion, joint, setting)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        """Return why this motion does not excite the effect."""
        return self.effect.untestable(motion, joint)
