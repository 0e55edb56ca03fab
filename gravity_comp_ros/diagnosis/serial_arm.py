"""
Serial arm fitted to gravity jointly with friction and the arm's dynamics.

The axes and first moments of the arm determine its dynamics except for the lengths between axes
(`models.kinematic.unknown_lengths`). Dynamics are fitted jointly with gravity and subtracted,
and the arm is fitted again. There is no result if no serial arm fits the torque.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.effects.arm_dynamics import (
    axis_sign_options, axis_signs, chain_dynamics, with_axis_signs)
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_fit import MotionProblem
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.base_level import is_level
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_fit import rough_fit
from gravity_comp_ros.models.kinematic.chain_starts import SearchOptions
import numpy as np

_SAMPLES = 500
# Iterations between dynamics and gravity.
_ITERATIONS = 3
# Maximum ratio of the residual to that of the unstructured energy, which has more coefficients;
# the geometric mean over joints.
_MAX_RESIDUAL_RATIO = 1.1


@dataclass(frozen=True, eq=False)
class SerialArm:
    """An arm, and the samples it was fitted to, without friction and dynamics."""

    chain: Chain
    cleaned: JointSamples


def fit_serial_arm(motion: Motion, cleaned: JointSamples, reference: FloatArray,
                   start: Chain | None = None) -> SerialArm | None:
    """
    Return the serial arm that fits gravity, or None.

    :param motion: motion of the samples to fit.
    :param cleaned: initial torque without friction and inertia, from an unstructured energy.
    :param reference: (M, N) in N·m, residual of that energy; level if the base is nearly level.
    :param start: the chain of the user's model; the search ends at the better of two minima.
    """
    chain, samples = _best_chain(cleaned, start), motion.samples
    if chain is not None:
        chain = _with_signs_of_motion(chain, motion)
    for _ in range(_ITERATIONS):
        if chain is None:
            return None
        gravity = tangent(samples.q, chain)
        n_tilts = gravity.shape[2] - chain.moments.size
        dynamics = chain_dynamics(chain, axis_signs(chain, samples.q))
        fit = MotionProblem.of(gravity, n_tilts, motion, dynamics).fit()
        cleaned = replace(samples, tau=samples.tau - fit.nuisance)
        chain = fit_chain(cleaned, chain)
    excess = _mean_log_std(fit.residual) - _mean_log_std(reference)
    if chain is None or excess > np.log(_MAX_RESIDUAL_RATIO):
        return None
    return SerialArm(chain, cleaned)


def _with_signs_of_motion(chain: Chain, motion: Motion) -> Chain:
    """Return the chain with the signs of vertical axes that fit the motion best."""
    options = axis_sign_options(chain, motion.samples.q)
    if len(options) == 1:
        return chain
    gravity = tangent(motion.samples.q, chain)
    n_tilts = gravity.shape[2] - chain.moments.size
    errors = [MotionProblem.of(gravity, n_tilts, motion, chain_dynamics(chain, signs)
                               ).held_out_errors((1.0,))[0] for signs in options]
    return with_axis_signs(chain, options[int(np.argmin(errors))])


def _best_chain(cleaned: JointSamples, start: Chain | None) -> Chain | None:
    """Return the better of the chains that a cold search finds, and one from a start."""
    fitted = [fit_chain(cleaned, None), None if start is None else fit_chain(cleaned, start)]
    chains = [chain for chain in fitted if chain is not None]
    return min(chains, default=None,
               key=lambda chain: _mean_log_std(cleaned.tau - chain.torque(cleaned.q)))


def _mean_log_std(residual: FloatArray) -> float:
    """Return the mean over joints of the logarithm of the standard deviation."""
    return float(np.log(np.maximum(residual.std(axis=0), 1e-9)).mean())


def fit_chain(cleaned: JointSamples, start: Chain | None) -> Chain | None:
    """Return the fitted serial arm, optionally from a start; None if the fit fails."""
    few = cleaned.select(evenly_picked(cleaned.n_samples, _SAMPLES))
    try:
        return rough_fit(few, SearchOptions() if start is None else None, start).chain
    except GravityCompError:
        return None


def tangent(q: FloatArray, chain: Chain) -> FloatArray:
    """
    Return the derivatives of a serial arm's torques (M, N, K) by its parameters, moments last.

    A nearly level base is treated as level, and its tilt derivatives are left out.
    """
    level = level_arm(chain, q)
    columns = level.jacobian(q).transpose(2, 1, 0)
    return columns if level is chain else columns[:, :, 2:]


def level_arm(chain: Chain, q: FloatArray) -> Chain:
    """Return the chain on a level base if its base is nearly level, otherwise the chain itself."""
    if chain.n_joints < 2 or not is_level(chain.torque(q)):
        return chain
    axes = chain.axes.copy()
    axes[0] = np.eye(3) if axes[0, 2, 2] > 0.0 else np.diag([1.0, -1.0, -1.0])
    return Chain(axes, chain.moments)
