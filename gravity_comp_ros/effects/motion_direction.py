"""
Which way a joint moves, as its friction sees it: d from -1 to 1.

A sign that jumps at speed 0 does not exist in data: speed is noisy and filtered, and friction
itself builds up over some motion. And where a joint stands, friction may be gone, or hold on to
what it was. So the data chooses between two shapes,

    d = tanh(qd / width)       and       d = z(q; hold),

z being Dahl's element (`presliding`), which keeps its state at rest and turns within `hold` rad
of motion, at most half a milliradian: what takes longer is an effect of its own. Where friction
is not plain to see, d = tanh(qd / width) with the width that the noise of the speed asks for.
A width that is wrong by a few mrad/s would come back as a Stribeck effect of just that speed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.presliding import evenly_spaced, presliding_state, steady_path
from gravity_comp_ros.models.least_squares import svd
import numpy as np

# rad/s. Below this, encoders and drives are not to be trusted.
LEAST_WIDTH = 0.002
# rad over which a friction that holds at rest may turn.
HOLDS = (5e-5, 1e-4, 2e-4, 5e-4)
# The noise must be well inside the width, and the width well inside the speeds.
_NOISE_WIDTHS = 3.0
_WIDEST = 0.2
# Share of the residual that friction must explain before its shape is worth fitting.
_PLAIN = 0.2
# Holding on at rest must take this share off the error to be believed.
_BETTER = 0.01
_GRID = 10
_ROWS = 20000


@dataclass(frozen=True)
class Shape:
    """How a direction turns: over `width` rad/s, or, if not 0, within `hold` rad of motion."""

    width: float
    hold: float = 0.0


def direction(samples: JointSamples, q: FloatArray, qd: FloatArray, shape: Shape) -> FloatArray:
    """
    Return which way a joint, or a sum of joints, moves: (M,), -1 to 1.

    :param q: its angle (M,), rad. :param qd: its speed (M,), rad/s.
    """
    if shape.hold <= 0.0:
        return np.asarray(np.tanh(qd / shape.width))
    return _held(samples, _path(samples, q), shape.hold)


def least_widths(samples: JointSamples, joints: Sequence[int] | None = None) -> FloatArray:
    """Return the width in rad/s that the noise of each joint, or of some joints, asks for."""
    return np.maximum(LEAST_WIDTH, _NOISE_WIDTHS * speed_noise(samples, joints))


def speed_noise(samples: JointSamples, joints: Sequence[int] | None = None) -> FloatArray:
    """
    Return the standard deviation in rad/s of what in each joint's qd is noise and not motion.

    Fourth differences take out any smooth motion; their median size is unmoved by the few
    places where a motion sets in. Slower noise than that is taken for motion.
    """
    qd = samples.qd if joints is None else samples.qd[:, list(joints)]
    parts = [np.diff(qd[run], n=4, axis=0)[evenly_spaced(samples.t[run])]
             for run in run_slices(samples)]
    jumps = np.concatenate(parts) if parts else qd[:0]
    if not len(jumps):
        return np.zeros(qd.shape[1])
    # Var of the fourth difference of white noise: 1 + 16 + 36 + 16 + 1 = 70 times its own.
    return np.asarray(1.4826 * np.median(np.abs(jumps), axis=0) / np.sqrt(70.0))


def find_shape(samples: JointSamples, q: FloatArray, qd: FloatArray, qdd: FloatArray,
               residual: FloatArray, least_width: float) -> Shape:
    """
    Return the shape of the direction of one joint, or of a sum of joints.

    :param q: its angle (M,), rad. :param qd: its speed (M,), rad/s.
    :param qdd: acceleration (M,) of the joint, rad/s^2.
    :param residual: torque (M,) that gravity leaves, N·m; it only chooses the shape.
    """
    fit = _Fit(qd, qdd, residual)
    width, error = _best_width(fit, qd, least_width)
    if error > (1.0 - _PLAIN) * fit.without:
        return Shape(least_width)
    hold, held_error = _best_hold(fit, samples, _path(samples, q))
    return Shape(width, hold if held_error < (1.0 - _BETTER) * error else 0.0)


def _best_hold(fit: _Fit, samples: JointSamples, path: FloatArray) -> tuple[float, float]:
    """Return the hold that leaves the smallest error, and that error."""
    errors = [fit.error(_held(samples, path, hold)) for hold in HOLDS]
    best = int(np.argmin(errors))
    low, high = HOLDS[max(best - 1, 0)], HOLDS[min(best + 1, len(HOLDS) - 1)]
    hold, error = _between(lambda x: fit.error(_held(samples, path, x)), low, high, 0.05)
    if error < errors[best]:
        return hold, error
    return HOLDS[best], errors[best]


def _path(samples: JointSamples, q: FloatArray) -> FloatArray:
    return np.concatenate([steady_path(q[run], samples.t[run]) for run in run_slices(samples)])


def _held(samples: JointSamples, path: FloatArray, hold: float) -> FloatArray:
    return np.concatenate([presliding_state(path[run], hold) for run in run_slices(samples)])


class _Fit:
    """The squared error that a direction leaves, beside offset, viscous friction and inertia."""

    def __init__(self, qd: FloatArray, qdd: FloatArray, residual: FloatArray) -> None:
        self.rows = slice(None, None, max(1, len(qd) // _ROWS))
        plain = np.column_stack([np.ones_like(qd), qd, qdd])[self.rows]
        basis, size, _ = svd(plain)
        self.basis = basis[:, size > 1e-12 * size[0]]
        self.y = self._rest(residual[self.rows])
        self.without = float(self.y @ self.y)
        # What is below the arithmetic's noise is nothing.
        if self.without < 1e-9 * float(residual[self.rows] @ residual[self.rows]):
            self.without = 0.0

    def error(self, direction: FloatArray) -> float:
        d = self._rest(direction[self.rows])
        size = float(d @ d)
        return self.without - (float(d @ self.y) ** 2 / size if size > 0.0 else 0.0)

    def _rest(self, values: FloatArray) -> FloatArray:
        return np.asarray(values - self.basis @ (self.basis.T @ values))


def _best_width(fit: _Fit, qd: FloatArray, least: float) -> tuple[float, float]:
    """Return the width that leaves the smallest error, and that error."""
    widest = _WIDEST * float(np.quantile(np.abs(qd), 0.95))
    if fit.without == 0.0:
        return least, 1.0
    if widest <= least:
        return least, fit.error(np.tanh(qd / least))
    grid = np.geomspace(least, widest, _GRID)
    errors = [fit.error(np.tanh(qd / width)) for width in grid]
    best = int(np.argmin(errors))
    low, high = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, _GRID - 1)])
    width, error = _between(lambda x: fit.error(np.tanh(qd / x)), low, high, 0.02)
    return (width, error) if error < errors[best] else (float(grid[best]), errors[best])


def _between(error: Callable[[float], float], low: float, high: float,
             tolerance: float) -> tuple[float, float]:
    """Return the positive x with the smallest error, to a relative tolerance, and that error."""
    from scipy.optimize import minimize_scalar  # half a second that most runs do not need
    found = minimize_scalar(lambda x: error(float(np.exp(x))), bounds=(np.log(low), np.log(high)),
                            method='bounded', options={'xatol': tolerance})
    return float(np.exp(found.x)), float(found.fun)
