"""
The serial arm that explains gravity beside friction and the torque of its own motion.

Its axes and moments say how its links move each other, the lengths between axes apart
(`models.kinematic.unknown_lengths`). So the torque of motion is fitted beside gravity, taken off,
and the arm fitted again. Where no serial arm explains the torque, there is none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.effects.arm_dynamics import (
    chain_dynamics, axis_sign_options, turned, ways_of)
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_fit import MotionProblem
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.base_level import is_level
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_fit import rough_fit
from gravity_comp_ros.models.kinematic.chain_starts import SearchOptions
import numpy as np

_SAMPLES = 500
# The arm settles in a few turns of motion and gravity.
_TURNS = 3
# It may leave this much more than gravity without structure does, the joints' geometric mean:
# that has more coefficients.
_NO_WORSE = 1.1


@dataclass(frozen=True, eq=False)
class SerialArm:
    """An arm, and the samples it was fitted to: friction and torque of motion taken off."""

    chain: Chain
    cleaned: JointSamples


def fit_serial_arm(motion: Motion, cleaned: JointSamples, left: FloatArray) -> SerialArm | None:
    """
    Return the serial arm that explains gravity, or None.

    :param motion: of the samples to fit.
    :param cleaned: these without friction and inertia, as they are beside gravity without
        structure, to begin with.
    :param left: (M, N) in N·m, what those leave of an arm whose base is level if it is nearly so.
    """
    chain, samples = fit_chain(cleaned, None), motion.samples
    if chain is not None:
        chain = _pointed(chain, motion)
    for _ in range(_TURNS):
        if chain is None:
            return None
        gravity = tangent(samples.q, chain)
        n_tilts = gravity.shape[2] - chain.moments.size
        dynamics = chain_dynamics(chain, ways_of(chain, samples.q))
        found = MotionProblem.of(gravity, n_tilts, motion, dynamics).fit()
        cleaned = replace(samples, tau=samples.tau - found.beside)
        chain = fit_chain(cleaned, chain)
    now, then = (np.log(np.maximum(part.std(axis=0), 1e-9)) for part in (found.residual, left))
    if chain is None or (now - then).mean() > np.log(_NO_WORSE):
        return None
    return SerialArm(chain, cleaned)


def _pointed(chain: Chain, motion: Motion) -> Chain:
    """Return the chain with vertical axes that turn the way that motion shows."""
    every = axis_sign_options(chain, motion.samples.q)
    if len(every) == 1:
        return chain
    gravity = tangent(motion.samples.q, chain)
    n_tilts = gravity.shape[2] - chain.moments.size
    errors = [MotionProblem.of(gravity, n_tilts, motion, chain_dynamics(chain, ways)
                               ).held_out_errors((1.0,))[0] for ways in every]
    return turned(chain, every[int(np.argmin(errors))])


def fit_chain(cleaned: JointSamples, start: Chain | None) -> Chain | None:
    """Return the serial arm that fits, from a start if there is one; None if none does."""
    few = cleaned.select(evenly_picked(cleaned.n_samples, _SAMPLES))
    try:
        return rough_fit(few, SearchOptions() if start is None else None, start).chain
    except GravityCompError:
        return None


def tangent(q: FloatArray, chain: Chain) -> FloatArray:
    """
    Return the derivatives of a serial arm's torques (M, N, K) by its parameters, moments last.

    A nearly level base is taken as level: what its tilt does is left for an effect to explain.
    """
    level = chain.n_joints > 1 and is_level(chain.torque(q))
    if level:
        axes = chain.axes.copy()
        axes[0] = np.eye(3) if axes[0, 2, 2] > 0.0 else np.diag([1.0, -1.0, -1.0])
        chain = Chain(axes, chain.moments)
    columns = chain.jacobian(q).transpose(2, 1, 0)
    return columns[:, :, 2:] if level else columns
