"""
The speed over which friction turns its sign.

A sign that jumps at speed 0 does not exist in data: speed is noisy and filtered, and friction
itself builds up over some motion. All friction columns use tanh(qd / width). The width is set
from the noise of the speed, and where friction is plain to see, fitted to the torque: a width
that is wrong by a few mrad/s comes back as a Stribeck effect of just that speed.
"""

from __future__ import annotations

from gravity_comp_ros.effects.motion_facts import run_slices
from gravity_comp_ros.samples import FloatArray, JointSamples
import numpy as np
from scipy.optimize import minimize_scalar

# rad/s. Below this, encoders and drives are not to be trusted.
LEAST_WIDTH = 0.002
# The noise must be well inside the width, and the width well inside the speeds.
_NOISE_WIDTHS = 3.0
_WIDEST = 0.2
# Share of the residual that friction must explain before its shape is worth fitting.
_PLAIN = 0.2
_GRID = 10
_ROWS = 20000


def sign_widths(samples: JointSamples, residual: FloatArray) -> FloatArray:
    """
    Return the width (N,) in rad/s of each joint.

    :param residual: torque that gravity leaves (M, N), N·m; of use where friction is most of
        it, and without influence elsewhere.
    """
    noise = speed_noise(samples)
    widths = np.maximum(LEAST_WIDTH, _NOISE_WIDTHS * noise)
    rows = slice(None, None, max(1, samples.n_samples // _ROWS))
    for n in range(samples.n_joints):
        widths[n] = _fitted(samples.qd[rows, n], residual[rows, n], float(widths[n]))
    return widths


def speed_noise(samples: JointSamples) -> FloatArray:
    """
    Return the standard deviation (N,) in rad/s of what in qd is noise and not motion.

    Fourth differences take out any smooth motion; their median size is unmoved by the few
    places where a motion sets in. Slower noise than that is taken for motion.
    """
    parts = [np.diff(samples.qd[run], n=4, axis=0) for run in run_slices(samples)]
    jumps = np.concatenate(parts) if parts else np.zeros((0, samples.n_joints))
    if not len(jumps):
        return np.zeros(samples.n_joints)
    # Var of the fourth difference of white noise: 1 + 16 + 36 + 16 + 1 = 70 times its own.
    return np.asarray(1.4826 * np.median(np.abs(jumps), axis=0) / np.sqrt(70.0))


def _fitted(speed: FloatArray, residual: FloatArray, start: float) -> float:
    """Return the width that fits best, or `start` if the residual is not friction's."""
    top = float(np.quantile(np.abs(speed), 0.95))
    widest = _WIDEST * top
    if widest <= start or residual.std() == 0.0:
        return start
    plain = np.column_stack([np.ones_like(speed), speed])

    def error(width: float, regressors: FloatArray = plain) -> float:
        columns = np.column_stack([regressors, np.tanh(speed / width)])
        gram = columns.T @ columns
        solved = np.linalg.lstsq(gram, columns.T @ residual, rcond=None)[0]
        return float(residual @ residual - solved @ (columns.T @ residual))

    without = residual - plain @ np.linalg.lstsq(plain, residual, rcond=None)[0]
    if float(without @ without) < 1e-9 * float(residual @ residual):
        return start
    grid = np.geomspace(start, widest, _GRID)
    errors = np.array([error(width) for width in grid])
    best = int(errors.argmin())
    if errors[best] > (1.0 - _PLAIN) * float(without @ without):
        return start
    low, high = np.log(grid[max(best - 1, 0)]), np.log(grid[min(best + 1, _GRID - 1)])
    found = minimize_scalar(lambda x: error(float(np.exp(x))), bounds=(low, high),
                            method='bounded', options={'xatol': 0.02})
    return float(np.exp(found.x)) if found.fun < errors[best] else float(grid[best])
