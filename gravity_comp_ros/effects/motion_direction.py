"""
Direction of a joint's friction: a smoothed sign of its speed, d from -1 to 1.

Measured friction does not jump at zero speed: the speed is noisy and filtered, and friction builds
up over some distance. At rest, friction can vanish or persist. The shape is one of

    d = tanh(qd / width),      d = qd / (2 width) up to 1,      and      d = z(q; hold),

selected by the data. The second, a ramp, is the shape in simulators that treat friction as a soft
constraint. z is Dahl's element (`presliding`), which keeps its state at rest and reverses within
`hold` rad of motion, at most 0.5 mrad; longer distances are a separate effect. If friction is
small, d = tanh(qd / width) with the width given by the speed noise. An error of the width of a few
mrad/s would appear as a Stribeck effect at that speed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.effects.presliding import (
    denoised_path, evenly_spaced, noise_of_fourth_differences, presliding_state)
from gravity_comp_ros.models.least_squares import svd
import numpy as np

# Minimum width in rad/s, the accuracy of encoders and drives.
MIN_WIDTH = 0.002
# Distances in rad over which friction that persists at rest reverses.
HOLDS = (5e-5, 1e-4, 2e-4, 5e-4)
# Minimum width relative to the speed noise, and maximum relative to the 95 % quantile of speeds.
_NOISE_WIDTHS = 3.0
_MAX_WIDTH, _MAX_RAMP_WIDTH = 0.2, 0.3
# Minimum share of the residual that friction explains for its shape to be fitted.
_MIN_FRICTION = 0.2
# Minimum reduction of the error by friction that persists at rest.
_MIN_IMPROVEMENT = 0.01
_GRID = 10
# Maximum number of samples of a fit.
_ROWS = 20000


@dataclass(frozen=True)
class Shape:
    """
    Shape of a direction: it reverses over `width` rad/s or, if not 0, over `hold` rad.

    With `ramp` it is proportional to the speed up to twice the width.
    """

    width: float
    hold: float = 0.0
    ramp: bool = False


def direction(samples: JointSamples, q: FloatArray, qd: FloatArray, shape: Shape) -> FloatArray:
    """
    Return the direction (M,), from -1 to 1, of a joint or a sum of joints.

    :param q: its angle (M,), rad. :param qd: its speed (M,), rad/s.
    """
    if shape.hold > 0.0:
        return _held(samples, _path(samples, q), shape.hold)
    return np.asarray((_ramp if shape.ramp else np.tanh)(qd / shape.width))


def smooth_sign(qd: FloatArray, width: FloatArray | float,
                ramp: BoolArray | bool = False) -> FloatArray:
    """Return the smoothed sign of speeds in rad/s, from -1 to 1."""
    return np.asarray(np.where(ramp, _ramp(qd / width), np.tanh(qd / width)))


def _ramp(x: FloatArray) -> FloatArray:
    """Return the ramp of speeds over width."""
    return np.clip(0.5 * x, -1.0, 1.0)


def min_widths(samples: JointSamples, joints: Sequence[int] | None = None) -> FloatArray:
    """Return the minimum width in rad/s for the speed noise of all or some joints."""
    return np.maximum(MIN_WIDTH, _NOISE_WIDTHS * speed_noise(samples, joints))


def speed_noise(samples: JointSamples, joints: Sequence[int] | None = None) -> FloatArray:
    """
    Return the standard deviation in rad/s of the white noise of each joint's speed.

    Fourth differences remove smooth motion; their median size is robust to the start of motions.
    Slow noise is not included.
    """
    qd = samples.qd if joints is None else samples.qd[:, list(joints)]
    parts = [np.diff(qd[run], n=4, axis=0)[evenly_spaced(samples.t[run])]
             for run in run_slices(samples)]
    jumps = np.concatenate(parts) if parts else qd[:0]
    if not len(jumps):
        return np.zeros(qd.shape[1])
    return noise_of_fourth_differences(jumps)


def find_shape(samples: JointSamples, q: FloatArray, qd: FloatArray, qdd: FloatArray,
               residual: FloatArray, min_width: float) -> Shape:
    """
    Return the shape of the direction of one joint, or of a sum of joints.

    :param q: its angle (M,), rad. :param qd: its speed (M,), rad/s.
    :param qdd: acceleration (M,) of the joint, rad/s^2.
    :param residual: torque (M,) minus gravity, N·m; it affects the shape only.
    """
    fit = _Fit(qd, qdd, residual)
    width, error = _best_width(fit, qd, min_width, np.tanh, _MAX_WIDTH)
    if error > (1.0 - _MIN_FRICTION) * fit.baseline:
        return Shape(min_width)
    shape = Shape(width)
    width, ramp_error = _best_width(fit, qd, min_width, _ramp, _MAX_RAMP_WIDTH)
    if ramp_error < error:
        shape, error = Shape(width, ramp=True), ramp_error
    hold, hold_error = _best_hold(fit, samples, _path(samples, q))
    return replace(shape, hold=hold if hold_error < (1.0 - _MIN_IMPROVEMENT) * error else 0.0)


def _best_hold(fit: _Fit, samples: JointSamples, path: FloatArray) -> tuple[float, float]:
    """Return the hold distance with the smallest error, and that error."""
    errors = [fit.error(_held(samples, path, hold)) for hold in HOLDS]
    best = int(np.argmin(errors))
    low, high = HOLDS[max(best - 1, 0)], HOLDS[min(best + 1, len(HOLDS) - 1)]
    hold, error = _between(lambda x: fit.error(_held(samples, path, x)), low, high, 0.05)
    if error < errors[best]:
        return hold, error
    return HOLDS[best], errors[best]


def _path(samples: JointSamples, q: FloatArray) -> FloatArray:
    return np.concatenate([denoised_path(q[run], samples.t[run]) for run in run_slices(samples)])


def _held(samples: JointSamples, path: FloatArray, hold: float) -> FloatArray:
    return np.concatenate([presliding_state(path[run], hold) for run in run_slices(samples)])


class _Fit:
    """Squared error of a direction, fitted with offset, viscous friction and inertia."""

    def __init__(self, qd: FloatArray, qdd: FloatArray, residual: FloatArray) -> None:
        self.rows = slice(None, None, max(1, len(qd) // _ROWS))
        basis, size, _ = svd(np.column_stack([np.ones_like(qd), qd, qdd])[self.rows])
        self.basis = basis[:, size > 1e-12 * size[0]]
        self.y = self._rest(residual[self.rows])
        self.baseline = float(self.y @ self.y)
        # Rounding error counts as 0.
        if self.baseline < 1e-9 * float(residual[self.rows] @ residual[self.rows]):
            self.baseline = 0.0

    def error(self, direction: FloatArray) -> float:
        d = self._rest(direction[self.rows])
        size = float(d @ d)
        return self.baseline - (float(d @ self.y) ** 2 / size if size > 0.0 else 0.0)

    def _rest(self, values: FloatArray) -> FloatArray:
        return np.asarray(values - self.basis @ (self.basis.T @ values))


def _best_width(fit: _Fit, qd: FloatArray, minimum: float,
                law: Callable[[FloatArray], FloatArray], share: float) -> tuple[float, float]:
    """
    Return the width with the smallest error, and that error.

    :param law: direction by speed over width.
    :param share: largest width, as a share of the 95 % quantile of the speeds.
    """
    widest = share * float(np.quantile(np.abs(qd), 0.95))
    if fit.baseline == 0.0:
        return minimum, 1.0
    if widest <= minimum:
        return minimum, fit.error(law(qd / minimum))
    grid = np.geomspace(minimum, widest, _GRID)
    errors = [fit.error(law(qd / width)) for width in grid]
    best = int(np.argmin(errors))
    low, high = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, _GRID - 1)])
    width, error = _between(lambda x: fit.error(law(qd / x)), low, high, 0.02)
    return (width, error) if error < errors[best] else (float(grid[best]), errors[best])


def _between(error: Callable[[float], float], low: float, high: float,
             tolerance: float) -> tuple[float, float]:
    """Return the positive x with the smallest error, to a relative tolerance, and that error."""
    from scipy.optimize import minimize_scalar  # imported here: it takes half a second
    best = minimize_scalar(lambda x: error(float(np.exp(x))), bounds=(np.log(low), np.log(high)),
                           method='bounded', options={'xatol': tolerance})
    return float(np.exp(best.x)), float(best.fun)
