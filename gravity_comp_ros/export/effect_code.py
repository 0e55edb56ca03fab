"""
C statements of the effects of a model whose torque depends on pose and speed alone.

Each law repeats the equation of its effect (`effects`), with g the gravity torque and d the
direction of motion; tests compare both. An effect without a law here, such as a tool force or
one that depends on time, on earlier samples or on acceleration, is left out with the reason. The
exported functions have no state: friction whose direction depends on the path, and which persists
at rest (`distance`), is written in motion only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from gravity_comp_ros.effects.motion_direction import COMPENSATION_SPEED, in_motion, law_of
from gravity_comp_ros.effects.registry import library_effects
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.export.gravity_code import Numbers
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.gravity_model import GravityModel

_NO_LAW = 'it has no law in C'

# Coefficient symbols, and settings that remain numbers; other settings select the code.
Law = Callable[['_Effect'], str]


@dataclass(frozen=True)
class EffectCode:
    """
    Statements that add the torque of effects to `tau`.

    `static` uses q and the gravity torque g, `friction` also the speeds qd. `included` and
    `left_out` are the targets of the effects, the second with the reason. `in_motion` are those
    of `included` that persist at rest in the model and vanish there in the code.
    """

    static: tuple[str, ...]
    friction: tuple[str, ...]
    included: tuple[str, ...]
    left_out: Mapping[str, str]
    in_motion: tuple[str, ...]


@dataclass
class _Effect:
    """An effect of one joint while its statement is written."""

    model: GravityModel
    effect: AppliedEffect
    numbers: Numbers
    used: set[str] = field(default_factory=set)

    @property
    def joint(self) -> int:
        return self.model.joints.index(str(self.effect.joint))

    @property
    def q(self) -> str:
        return f'q[{self.joint}]'

    @property
    def qd(self) -> str:
        return f'qd[{self.joint}]'

    def c(self, symbol: str) -> str:
        """Return the expression of a coefficient."""
        value = self.effect.coefficients[symbol]
        self.used.add(symbol)
        return self.numbers.add(f'{self._name()} {symbol} {value.unit}'.rstrip(), value.value)

    def setting(self, name: str, positive: bool = False) -> str:
        """Return the expression of a nonlinear parameter."""
        unit = library_effects()[self.effect.name].setting_units.get(name, '')
        return self.numbers.add(f'{self._name()} {name} {unit}'.rstrip(),
                                self.effect.setting[name], positive)

    def choice(self, name: str) -> float:
        """Return a nonlinear parameter that selects the code."""
        return float(self.effect.setting[name])

    def direction(self, speed: str = '') -> str:
        """Return the direction of a speed, by default the joint's (`smooth_sign`), -1 to 1."""
        speed = speed or self.qd
        if 'ramp' in self.effect.setting:
            return f'gc_ramp({speed} / {self.setting("ramp", positive=True)})'
        return f'GC_TANH({speed} / {self.setting("width", positive=True)})'

    def _name(self) -> str:
        """Return the target with the settings that select the code."""
        chosen = [f'{key}={value:g}' for key, value in sorted(self.effect.setting.items())
                  if key in _CHOICES]
        return ' '.join([self.effect.target, *chosen])


_CHOICES = ('side', 'overtones', 'harmonics', 'partner', 'sign', 'power')


def _hinge(e: _Effect) -> str:
    return f'gc_beyond({e.q}, {e.setting("start")}, GC_C({e.choice("side"):g}.0))'


def _spring(e: _Effect) -> str:
    orders = range(2, int(e.choice('overtones')) + 2)
    if not orders:
        return f'{e.c("k")} * ({e.q} - {e.setting("centre")}) + {e.c("m")}'
    return ' + '.join([f'{e.c(f"a_{m}")} * GC_SIN(GC_C({m}.0) * {e.q})' for m in orders]
                      + [f'{e.c(f"b_{m}")} * GC_COS(GC_C({m}.0) * {e.q})' for m in orders])


def _cable(e: _Effect) -> str:
    stretch = _hinge(e) if e.choice('side') else f'{e.q} - {e.setting("start")}'
    return (f'{e.c("k")} * gc_hardening({stretch}, {e.setting("half", positive=True)}, '
            f'{e.setting("order")}, {e.setting("hardening")})')


def _ripple(e: _Effect) -> str:
    orders = range(1, int(e.choice('harmonics')) + 1)
    angle = f'{e.setting("k")} * {e.q}'
    return ' + '.join(
        f'{e.c(symbol if len(orders) == 1 else f"{symbol}_{i}")} * {wave}(GC_C({i}.0) * {angle})'
        for symbol, wave in (('a', 'GC_SIN'), ('b', 'GC_COS')) for i in orders)


def _stribeck(e: _Effect) -> str:
    ratio = f'{e.qd} / {e.setting("speed", positive=True)}'
    return f'{e.c("F_s")} * {e.direction()} * GC_EXP(-gc_square({ratio}))'


def _coupled(e: _Effect) -> str:
    partner, sign = int(e.choice('partner')) - 1, '+' if e.choice('sign') > 0 else '-'
    return f'{e.c("F_k")} * {e.direction(f"({e.qd} {sign} qd[{partner}])")}'


STATIC: Mapping[str, Law] = {
    'torque_offset': lambda e: e.c('b'),
    'torque_gain': lambda e: f'{e.c("k")} * g[{e.joint}]',
    'joint_spring': _spring,
    'cable_stiffness': _cable,
    'end_stop': lambda e: f'{e.c("k")} * {_hinge(e)}',
    'torque_ripple': _ripple,
}


def _load(effect: _Effect) -> str:
    if 'friction' not in effect.effect.setting:
        return f'g[{effect.joint}]'
    return f'g[{effect.joint}] + {effect.setting("friction")} * {effect.direction()}'


FRICTION: Mapping[str, Law] = {
    'coulomb_friction': lambda e: f'{e.c("F_c")} * {e.direction()}',
    'viscous_friction': lambda e: f'{e.c("F_v")} * {e.qd}',
    'asymmetric_friction': lambda e: f'{e.c("F_a")} * GC_FABS({e.direction()})',
    'load_dependent_friction':
        lambda e: f'{e.c("mu")} * GC_FABS({_load(e)}) * {e.direction()}',
    'stribeck_friction': _stribeck,
    'degressive_friction': lambda e: (f'{e.c("F_d")} * {e.direction()} * GC_POW('
                                      f'GC_FABS({e.qd}), GC_C({e.choice("power")!r}))'),
    'coupled_friction': _coupled,
}


def effect_code(model: GravityModel, numbers: Numbers) -> EffectCode:
    """
    Return the statements of all effects of a model that have a law here.

    Order of the numbers: by effect, in the order of the model.
    """
    lines: dict[bool, list[str]] = {True: [], False: []}
    included: list[str] = []
    moving: list[str] = []
    left_out: dict[str, str] = {}
    for effect in model.applied.effects:
        law = STATIC.get(effect.name) or FRICTION.get(effect.name)
        if law is None or effect.joint is None:
            left_out[effect.target] = _NO_LAW
            continue
        coded = _elsewhere(replace(effect, setting=in_motion(effect.setting, COMPENSATION_SPEED)))
        trial = _Effect(model, coded, Numbers())
        try:
            law(trial)
            if trial.used != set(coded.coefficients):
                raise DataError(f'unknown coefficients {sorted(effect.coefficients)}')
        except (KeyError, DataError):
            left_out[effect.target] = ('its coefficients or nonlinear parameters are not those '
                                       'of the law that is exported')
            continue
        written = _Effect(model, coded, numbers)
        is_static = effect.name in STATIC
        lines[is_static].append(f'    tau[{written.joint}] += {law(written)};')
        included.append(effect.target)
        if 'distance' in law_of(effect.setting):
            moving.append(effect.target)
    return EffectCode(tuple(lines[True]), tuple(lines[False]), tuple(included), left_out,
                      tuple(moving))


def _elsewhere(effect: AppliedEffect) -> AppliedEffect:
    """Return an effect with its mean alone, if it has one value for each recording."""
    if not {'start_1', 'recording_1'} & set(effect.setting):
        return effect
    return replace(effect, setting={}, coefficients={
        symbol: x for symbol, x in effect.coefficients.items() if not symbol.startswith('d_')})
