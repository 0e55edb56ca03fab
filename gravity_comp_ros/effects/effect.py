"""
What an effect is: a torque that gravity cannot explain, linear in a few coefficients.

    tau_residual = sum_k coefficient_k column_k(q, qd, qdd, g, t; setting)

Columns are computed from the motion and from the predicted gravity torque g, never from the
measured torque: noise would otherwise explain itself. What an effect is not linear in (a
velocity, a distance, a time) is its setting, and is scanned.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.effects.motion_direction import direction, Shape
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.gravity_gradient import gravity_gradient
from gravity_comp_ros.models.gravity_model import GravityModel

Setting = Mapping[str, float]


@dataclass(frozen=True)
class Motion:
    """
    What effect columns are computed from.

    `samples` are the measured q, qd, tau of all runs; `qdd` (M, N) in rad/s^2 is estimated from
    them; `gravity` (M, N) in N·m is the torque that the gravity model predicts; `slopes` its
    `gradient` where that is known without the model; `sign_width` (N,) in rad/s is the speed
    over which a joint's friction turns its sign, as far as the data tells.
    `model` is the gravity model itself, for effects that are made of its terms. `hold` (N,) in
    rad is the way over which the direction of a joint turns whose friction holds on at rest, 0
    (as for all, if not given) for a joint whose friction lets go.
    """

    samples: JointSamples
    qdd: FloatArray
    gravity: FloatArray
    slopes: FloatArray | None
    sign_width: FloatArray
    model: GravityModel | None = None
    hold: FloatArray | None = None
    # What is the same for all settings of an effect, kept while the motion lives.
    memo: dict[str, FloatArray] = field(default_factory=dict, init=False, repr=False,
                                        compare=False)

    @property
    def gradient(self) -> FloatArray:
        """
        Return d gravity_n / d q_j (M, N, N) in N·m/rad, the model's stiffness.

        It is computed for the effects that ask for it: few do, and it costs more than the rest.
        """
        if self.slopes is not None:
            return self.slopes
        if 'gradient' not in self.memo:
            if self.model is None:
                raise ValueError('a motion without a model has no gradient of its gravity')
            self.memo['gradient'] = gravity_gradient(self.model, self.samples.q)
        return self.memo['gradient']

    def direction(self, joint: int) -> FloatArray:
        """Return which way a joint moves as its friction sees it, (M,), -1 to 1."""
        key = f'direction {joint}'
        if key not in self.memo:
            hold = 0.0 if self.hold is None else float(self.hold[joint])
            self.memo[key] = direction(
                self.samples, self.samples.q[:, joint], self.samples.qd[:, joint],
                Shape(float(self.sign_width[joint]), hold))
        return self.memo[key]

    def at(self, rows: IntArray) -> Motion:
        """Return the motion at some samples, (K,) rising numbers, for pointwise effects."""
        for joint in range(self.samples.n_joints):
            self.direction(joint)
        slopes = None if self.slopes is None else self.slopes[rows]
        part = replace(self, samples=self.samples.select(rows), qdd=self.qdd[rows],
                       gravity=self.gravity[rows], slopes=slopes)
        part.memo.update({key: value[rows] for key, value in self.memo.items()})
        return part


@dataclass(frozen=True)
class Coefficient:
    """One coefficient of an effect: its symbol, unit and meaning."""

    symbol: str
    unit: str
    meaning: str


# (motion, joint, setting) -> columns: (M, K) for an effect of one joint, (M, N, K) of the arm.
Columns = Callable[[Motion, int, Setting], FloatArray]
# (motion, joint, setting) -> the K coefficients, where their number depends on the arm.
Symbols = Callable[[Motion, int, Setting], tuple[Coefficient, ...]]
# (motion, joint) -> the settings worth trying on this motion; none if it cannot be judged.
Settings = Callable[[Motion, int], list[dict[str, float]]]
# (motion, joint, setting) -> finer settings around one that the scan has found.
Refinement = Callable[[Motion, int, Setting], list[dict[str, float]]]
# (motion, joint) -> why this motion cannot show the effect, or None if it can.
Untestable = Callable[[Motion, int], str | None]
# (motion, joint, setting) -> how large the K coefficients are before any data, inf where free.
Spread = Callable[[Motion, int, Setting], FloatArray]
# (coefficients, setting, motion, joint) -> why these values are not physical, or None.
Implausible = Callable[[FloatArray, Setting, Motion, int], str | None]


def no_settings(motion: Motion, joint: int) -> list[dict[str, float]]:
    """Return the one empty setting of an effect that is linear throughout."""
    return [{}]


def no_refinement(motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
    """Return nothing: the scan is fine enough."""
    return []


def always_testable(motion: Motion, joint: int) -> str | None:
    """Return None: any motion shows the effect."""
    return None


def always_plausible(values: FloatArray, setting: Setting, motion: Motion,
                     joint: int) -> str | None:
    """Return None: coefficients of either sign and any size are physical."""
    return None


@dataclass(frozen=True)
class OtherLaw:
    """Columns of the same shape as an effect's, and what it means if they explain more."""

    columns: Columns
    words: str


@dataclass(frozen=True)
class Effect:
    """
    A physical effect, with all that the tool says about it.

    `scope` is 'joint' (acts on the torque of one joint) or 'arm' (on several at once; columns
    are then (M, N, K)). `per_joint` says whether the effect is about a joint, as an encoder's
    offset is although it acts on several torques; a tilted base is not, so it is tried once,
    and the joint number that its functions are given means nothing. `coefficients` has one
    entry a column; where their number depends on the arm, it shows the kinds that occur and
    `coefficients_of` gives them all. `confounders` names effects that can look alike;
    `experiment` is the motion that tells them apart, with `{joint}` for the joint's name;
    `signature` names the plot in which it shows (x axis). `taken` names the settings that are
    not scanned but taken from the motion as it is, such as the middle of a range, so that the
    columns mean the same on other motions. `corrects` names effects one of which must be there on
    the joint before this one, which corrects it, is looked for. `otherwise` is another law by
    which the same cause could act, where no effect has it: what follows that is not this effect.
    `pointwise` says that a column's value at a sample depends on that sample alone. `spread` gives
    the standard deviations of the coefficients before any data, for effects that have more of
    them than a motion may show; None leaves them free. `certain` says that every arm has the
    effect wherever it is testable.

    :raises OptionError: if the scope is unknown or there is no coefficient.
    """

    name: str
    title: str
    family: str
    equation: str
    description: str
    coefficients: tuple[Coefficient, ...]
    columns: Columns
    confounders: tuple[str, ...]
    experiment: str
    signature: str
    source: str
    scope: str = 'joint'
    per_joint: bool = True
    settings: Settings = no_settings
    untestable: Untestable = always_testable
    implausible: Implausible = always_plausible
    setting_units: Mapping[str, str] = field(default_factory=dict)
    taken: tuple[str, ...] = ()
    corrects: tuple[str, ...] = ()
    refine: Refinement = no_refinement
    symbols: Symbols | None = None
    otherwise: OtherLaw | None = None
    pointwise: bool = False
    spread: Spread | None = None
    certain: bool = False

    def __post_init__(self) -> None:
        if self.scope not in ('joint', 'arm'):
            raise OptionError(f'effect {self.name}: scope is {self.scope!r}; it must be '
                              f"'joint' or 'arm'")
        if not self.coefficients:
            raise OptionError(f'effect {self.name} has no coefficient')
        if not self.per_joint and self.scope == 'joint':
            raise OptionError(f"effect {self.name}: it has scope 'joint', so it is per_joint")

    def n_scanned(self, setting: Setting) -> int:
        """Return how many numbers of a setting were chosen among several."""
        return sum(name not in self.taken for name in setting)

    def coefficients_of(self, motion: Motion, joint: int,
                        setting: Setting) -> tuple[Coefficient, ...]:
        """Return one coefficient for each column that `columns` returns for the same motion."""
        if self.symbols is None:
            return self.coefficients
        return self.symbols(motion, joint, setting)
