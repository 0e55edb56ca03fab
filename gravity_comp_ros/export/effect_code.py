"""
C statements of the effects of a model whose torque depends on pose and speed alone.

Each law repeats the equation of its effect (`effects`), with g the gravity torque and d the
direction of motion; tests compare both. An effect without a law here, such as a tool force, is
written as a sum over the dictionary if its torque is one (`_dictionary_torque`). Others depend on
time, on earlier samples or on acceleration, and are left out with the reason. The exported
functions have no state: friction whose direction depends on the path, and which persists at rest
(`distance`), is written in motion only, as the node sends it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Needs
from gravity_comp_ros.effects.motion_direction import COMPENSATION_SPEED, in_motion, law_of
from gravity_comp_ros.effects.predict import installed, torque_of
from gravity_comp_ros.effects.registry import library_effects
from gravity_comp_ros.errors import DataError, GravityCompError
from gravity_comp_ros.export.gravity_code import sum_code
from gravity_comp_ros.export.numbers import Numbers
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.sparse.dictionary import Expansion, torque_of as sums_at
import numpy as np

_NOT_A_FUNCTION = 'its torque is not a function of pose and speed alone'
# Number of joints up to which 3^N poses are evaluated at once.
_MAX_JOINTS = 9
# Weights below this share of the largest torque are rounding, and so are deviations.
_ROUNDING = 1e-10
_CHECKED = 64

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
            torques = _dictionary_torque(model, effect)
            if torques is None:
                left_out[effect.target] = _NOT_A_FUNCTION
            else:
                lines[True] += sum_code(model.joints, torques, numbers, f'{effect.target} ')
                included.append(effect.target)
            continue
        coded = replace(effect, setting=in_motion(effect.setting, COMPENSATION_SPEED))
        trial = _Effect(model, coded, Numbers())
        try:
            law(trial)
            if trial.used != set(effect.coefficients):
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


def _dictionary_torque(
        model: GravityModel, effect: AppliedEffect) -> tuple[Expansion, ...] | None:
    """
    Return the torque of an effect as a sum over the dictionary per joint, N·m, or None.

    A sum over products of one factor {1, sin q_n, cos q_n} per joint is determined by its values
    at the 3^N poses whose angles are 0 and ±2 pi / 3: along each joint, three values give the
    three weights. Other poses and speeds show whether the torque is such a sum.
    """
    n = model.n_joints
    if n > _MAX_JOINTS:
        return None
    angles = np.array([0.0, 2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0])
    grid = np.stack(np.meshgrid(*n * [angles], indexing='ij'), axis=-1).reshape(-1, n)
    rng = np.random.default_rng(0)
    others, speeds = rng.uniform(-3.0, 3.0, (_CHECKED, n)), rng.normal(0.0, 1.0, (_CHECKED, n))
    try:
        if installed(effect).needs is not Needs.SPEED:
            return None
        at_grid = torque_of(model, [effect], _at(model, grid, 0.0 * grid))
        at_others = torque_of(model, [effect], _at(model, others, speeds))
    except GravityCompError:
        return None
    scale = float(np.abs(at_grid).max(initial=1e-9))
    torques = tuple(_sum(values, scale, n) for values in at_grid.T)
    deviation = np.abs(sums_at(torques, others) - at_others).max()
    return torques if deviation <= 1e3 * _ROUNDING * scale else None


def _at(model: GravityModel, q: FloatArray, qd: FloatArray) -> JointSamples:
    return JointSamples.single_run(model.joints, np.arange(len(q)), q, qd, np.zeros_like(q))


def _sum(values: FloatArray, scale: float, n: int) -> Expansion:
    """Return the sum with these values (3^N,) on the grid."""
    third, root = 1.0 / 3.0, 1.0 / np.sqrt(3.0)
    to_weights = np.array([[third, third, third], [0.0, root, -root],
                           [2.0 * third, -third, -third]])
    weights = values.reshape(n * (3,))
    for joint in range(n):
        weights = np.moveaxis(np.tensordot(to_weights, weights, axes=(1, joint)), 0, joint)
    flat = weights.ravel()
    kept = np.flatnonzero(np.abs(flat) > _ROUNDING * scale)
    return Expansion(kept, flat[kept])
