"""
Direction of a joint's friction: a smoothed sign of its speed, d from -1 to 1.

Measured friction does not jump at zero speed: the speed is noisy and filtered, and friction builds
up over some distance. Which law a joint follows is a nonlinear setting of the friction effects:

    width:     d = tanh(qd / width)                     friction that vanishes at rest
    ramp:      d = qd / ramp, between -1 and 1          simulators with soft constraints
    distance:  dz/dq = (1 - z sign(dq)) / distance      Dahl's element, which persists at rest
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

from gravity_comp_ros.data.constants import MAD
from gravity_comp_ros.data.runs import reversals_of, run_slices
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.effects.refining import scaled
import numpy as np

WIDTHS = (0.002, 0.005, 0.012, 0.03)            # rad/s
RAMPS = (0.01, 0.03, 0.08)                      # rad/s
DISTANCES = (0.00015, 0.0003, 0.0007, 0.0015, 0.003, 0.006, 0.02)  # rad
LAW_UNITS = {'width': 'rad/s', 'ramp': 'rad/s', 'distance': 'rad'}
# Minimum width relative to the speed noise: below, a law follows the noise.
_NOISE_WIDTHS = 1.0
# Minimum speed in rad/s with a certain direction, the accuracy of encoders and drives, and the
# same in standard deviations of the speed noise.
_MIN_SPEED, _CERTAIN = 0.002, 3.0
_GRIDS = {'width': WIDTHS, 'ramp': RAMPS, 'distance': DISTANCES}
# By how much a refined law may lie below and above the grid. Far below, laws are steps; above,
# friction that no slow motion saturates is viscous friction or a spring.
_BELOW, _ABOVE = 4.0, 1.5
# The law with the shortest distance that is compared.
SHORTEST = {'distance': DISTANCES[0] / _BELOW}
# Speed over which exported friction changes its sign, rad/s: above the noise of a
# velocity at rest.
COMPENSATION_SPEED = 0.02
# Minimum return that counts as a reversal, in standard deviations of the encoder noise.
_REVERSAL = 9.0
# Minimum motion, as a share of the distance, that counts as a reversal of a live element. Encoder
# noise at rest is smaller; it would otherwise erase the state.
_MIN_REVERSAL = 0.1
# Orders of the differences for white noise. Once scaled, those of white noise have the same
# standard deviation, those of motion a smaller one the higher the order.
_ORDERS = (4, 6, 8)
# Maximum ratio of time steps in an evenly spaced window, and minimum share of such windows.
_MAX_STEP_RATIO = 1.2
_MIN_EVEN_SHARE = 0.05


def laws(speed_noise: float) -> list[dict[str, float]]:
    """Return the laws to compare on a joint whose speed has this noise, rad/s."""
    smallest = _NOISE_WIDTHS * speed_noise
    widths = [w for w in WIDTHS if w >= smallest] or [smallest]
    return [*({'width': w} for w in widths), *({'ramp': w} for w in RAMPS if w >= smallest),
            *({'distance': d} for d in DISTANCES)]


def law_of(setting: Mapping[str, float]) -> dict[str, float]:
    """Return the law among the nonlinear parameters of an effect."""
    return {name: setting[name] for name in LAW_UNITS if name in setting}


def speed_law(setting: Mapping[str, float], width: float) -> dict[str, float]:
    """
    Return the law of a setting if it depends on speed alone, else one that vanishes at rest.

    :param width: of the other law, rad/s.
    """
    return {name: value for name, value in law_of(setting).items() if name != 'distance'} or {
        'width': width}


def in_motion(setting: Mapping[str, float], width: float) -> dict[str, float]:
    """Return a setting whose friction vanishes at rest (`speed_law`), if it has a law."""
    others = {name: value for name, value in setting.items() if name not in LAW_UNITS}
    return {**others, **(speed_law(setting, width) if law_of(setting) else {})}


def refined_laws(setting: Mapping[str, float], step: float,
                 speed_noise: float) -> list[dict[str, float]]:
    """
    Return the setting with a smaller and a larger parameter of its law.

    :param speed_noise: of the joint, rad/s, below which a law of the speed follows the noise.
    """
    (name,) = law_of(setting)
    grid = _GRIDS[name]
    minimum = _NOISE_WIDTHS * speed_noise if LAW_UNITS[name] == 'rad/s' else 0.0
    low, high = max(grid[0] / _BELOW, minimum), max(grid[-1] * _ABOVE, minimum)
    return scaled(setting, name, step, low, high)


def direction(samples: JointSamples, path: FloatArray, qd: FloatArray,
              law: Mapping[str, float]) -> FloatArray:
    """
    Return the direction (M,), from -1 to 1, of a joint or a sum of joints.

    :param path: its denoised angle (M,), rad (`path_of`). :param qd: its speed (M,), rad/s.
    """
    if 'distance' in law:
        return np.concatenate([presliding_state(path[run], law['distance'], law.get('skew', 0.0))
                               for run in run_slices(samples)])
    return smooth_sign(qd, law)


def directions(samples: JointSamples, joint: int) -> FloatArray:
    """
    Return the directions (M, K) of a joint by every law of friction that its speed noise allows.

    A sum of them has the law of a gear: after a reversal friction builds up over a distance.
    """
    path, qd = path_of(samples, samples.q[:, joint]), samples.qd[:, joint]
    return np.stack([direction(samples, path, qd, law)
                     for law in laws(float(speed_noise(samples)[joint]))], axis=1)


def smooth_sign(qd: FloatArray, law: Mapping[str, float]) -> FloatArray:
    """Return the direction of speeds in rad/s by a law that depends on speed alone."""
    if 'ramp' in law:
        return np.clip(qd / law['ramp'], -1.0, 1.0)
    return np.asarray(np.tanh(qd / law['width']))


def min_speeds(noise: FloatArray) -> FloatArray:
    """Return the speed above which a direction is certain, for a noise of speeds, rad/s."""
    return np.maximum(_MIN_SPEED, _CERTAIN * noise)


def path_of(samples: JointSamples, q: FloatArray) -> FloatArray:
    """Return an angle (M,) in rad, without encoder noise and monotonic between reversals."""
    return np.concatenate([denoised_path(q[run], samples.t[run]) for run in run_slices(samples)])


def speed_noise(samples: JointSamples) -> FloatArray:
    """Return the standard deviation in rad/s of the white noise of each joint's speed, (N,)."""
    return white_noise([(samples.qd[run], samples.t[run]) for run in run_slices(samples)])


def white_noise(runs: Sequence[tuple[FloatArray, FloatArray | None]]) -> FloatArray:
    """
    Return the standard deviation (...) of the white noise of values in several runs.

    It is the smallest of the estimates by several orders of differences. Their medians are robust
    to the start of motions. Slow noise is not included.

    :param runs: values (M, ...) and their times (M,) in s, to exclude differences over lost
        messages; without times they are evenly spaced.
    """
    smallest = np.full(runs[0][0].shape[1:], np.inf)
    for order in _ORDERS:
        parts = [_differences(values, t, order) for values, t in runs if len(values) > order]
        if sum(map(len, parts)):
            size = np.median(np.abs(np.concatenate(parts)), axis=0)
            # The variance of a difference is the sum of squared binomial coefficients.
            smallest = np.minimum(smallest, MAD * size / np.sqrt(math.comb(2 * order, order)))
    return np.asarray(np.where(np.isfinite(smallest), smallest, 0.0))


def _differences(values: FloatArray, t: FloatArray | None, order: int) -> FloatArray:
    differences = np.diff(values, n=order, axis=0)
    return differences if t is None else differences[evenly_spaced(t, order)]


def evenly_spaced(t: FloatArray, order: int) -> BoolArray:
    """Return a mask of the evenly spaced ones of M - order windows; all if few are."""
    steps = np.diff(t)
    if len(steps) < order:
        return np.zeros(0, dtype=bool)
    windows = [steps[k:len(steps) - order + k + 1] for k in range(order)]
    even = np.maximum.reduce(windows) <= _MAX_STEP_RATIO * np.minimum.reduce(windows)
    return np.asarray(even if even.mean() >= _MIN_EVEN_SHARE else np.ones(len(even), dtype=bool))


class LiveElement:
    """
    Dahl's element angle by angle, as a control loop reads them.

    :param distance: rad. :param skew: as in `presliding_state`.
    """

    def __init__(self, distance: float, skew: float = 0.0) -> None:
        self._distance, self._skew = distance, skew
        # The last angle in the present direction, and the state there.
        self._angle: float | None = None
        self._direction = self._state = 0.0

    def state(self, angle: float) -> float:
        """Return the state, from -1 to 1, at an angle in rad; angles are in order of time."""
        if self._angle is None:
            self._angle = angle
        moved = angle - self._angle
        direction = math.copysign(1.0, moved)
        over = self._distance * (1.0 + self._skew * direction)
        state: float = _built_up(self._state, direction + self._skew,
                                 math.exp(-abs(moved) / over))
        if direction == self._direction or abs(moved) >= _MIN_REVERSAL * self._distance:
            self._angle, self._direction, self._state = angle, direction, state
        return state


def presliding_state(path: FloatArray, distance: float, skew: float = 0.0) -> FloatArray:
    """
    Return the state z, from -1 to 1, of Dahl's element along a path (M,) in rad of one run.

    dz/dq = (1 - z sign(dq)) / distance is solved exactly between reversals (Dahl 1968):
    z = s + (z_r - s) exp(-d / distance), s the direction, z_r the state at the reversal and d the
    distance since then. The initial state is 0 and decays within a few distances.

    :param distance: rad.
    :param skew: by how much the level is larger in the positive direction, less than 1. The
        stiffness is the same in both, so the levels are skew + s and the distances
        (1 + s skew) distance.
    """
    steps = np.diff(path, prepend=path[:1])
    travelled, direction = np.cumsum(np.abs(steps)), np.sign(steps)
    # The direction persists during a pause, so that a pause is not a reversal.
    last_move = np.maximum.accumulate(np.where(direction != 0.0, np.arange(len(path)), 0))
    direction = direction[last_move]
    begin = np.append(0, np.flatnonzero(np.diff(direction, prepend=direction[:1])))
    end = np.append(begin[1:], len(path))
    at_begin = np.where(begin > 0, travelled[begin - 1], 0.0)
    level, over = direction + skew * np.abs(direction), distance * (1.0 + skew * direction)
    decay = np.exp((at_begin - travelled[end - 1]) / over[begin])
    states, state = [], 0.0
    for final, factor in zip(level[begin].tolist(), decay.tolist()):
        states.append(state)
        state = _built_up(state, final, factor)
    initial, since = np.repeat(np.array([states, at_begin]), end - begin, axis=1)
    return np.asarray(_built_up(initial, level, np.exp((since - travelled) / over)))


def _built_up(state: Any, level: Any, decay: Any) -> Any:
    """Return the state after a motion towards a level; `decay` is exp(-travel / distance)."""
    return level + (state - level) * decay


def denoised_path(q: FloatArray, t: FloatArray | None = None) -> FloatArray:
    """
    Return q (M,) of one run in rad, monotonic between reversals.

    A reversal is detected where q has returned by some standard deviations of the encoder noise;
    it is located at the extremum of q. Encoder noise at rest then does not change the state of
    presliding friction.

    :param t: times (M,) in s; evenly spaced by default.
    """
    minimum = _REVERSAL * float(white_noise([(q, t)]))
    if minimum <= 0.0:
        return q
    detected = reversals_of(q, minimum)
    path, at, sign = np.empty_like(q), 0, detected[0][1] if detected else 0.0
    for sample, _ in detected[1:]:
        extremum = at + int(np.argmax(sign * q[at:sample + 1]))
        path[at:extremum + 1] = sign * np.maximum.accumulate(sign * q[at:extremum + 1])
        at, sign = extremum, -sign
    path[at:] = sign * np.maximum.accumulate(sign * q[at:]) if sign else q[0]
    return path
