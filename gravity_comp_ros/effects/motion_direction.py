"""
Direction of a joint's friction: a smoothed sign of its speed, d from -1 to 1.

Measured friction does not jump at zero speed: the speed is noisy and filtered, and friction builds
up over some distance. Which law a joint follows is a nonlinear setting of the friction effects:

    width:     d = tanh(qd / width)                     friction that vanishes at rest
    ramp:      d = qd / ramp, between -1 and 1          simulators with soft constraints
    distance:  dz/dq = (1 - z sign(dq)) / distance      Dahl's element, which persists at rest
"""

from __future__ import annotations

from collections.abc import Mapping

from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.presliding import denoised_path, presliding_state
from gravity_comp_ros.effects.refining import scaled
from gravity_comp_ros.effects.white_noise import white_noise
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
