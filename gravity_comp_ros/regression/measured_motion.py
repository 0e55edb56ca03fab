"""
Errors in variables: torque that the noise of angles and speeds causes in the columns of terms.

Friction reverses over a distance that may be as short as the noise of an encoder, so that a row
with a reversal has a much larger error than the others (W. A. Fuller, Measurement Error Models,
1987). Its variance is that over draws of the noise.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.white_noise import white_noise
from gravity_comp_ros.regression.candidates import TermFactory
from gravity_comp_ros.regression.posterior import Posterior
import numpy as np

# Number of draws of the noise.
_DRAWS = 4


def variance_by_motion(posterior: Posterior, factory: TermFactory) -> FloatArray:
    """Return the variance (R, N) in (N·m)^2 of each row by the noise of the measured motion."""
    draws = [_change(posterior, factory, np.random.default_rng(seed)) for seed in range(_DRAWS)]
    return np.asarray(np.mean(np.square(draws), axis=0))


def _change(posterior: Posterior, factory: TermFactory, rng: np.random.Generator) -> FloatArray:
    """Return the change (R, N) in N·m of the terms' torque by a draw of the noise."""
    noisy, n = _with_more_noise(factory.motion, rng), posterior.design.n_joints
    drawn, change = TermFactory(lambda: noisy, factory.rows, factory.scale), np.zeros(
        (factory.rows.n_rows, n))
    for term in posterior.terms:
        # Columns at the same gravity: those of the posterior are of the step before.
        other, own = (each.term(term.effect, term.joint, term.setting)
                      for each in (drawn, factory))
        for j in term.joints(n):
            change[:, j] += (other.on(j) - own.on(j)) @ posterior.beta[posterior.at[term]]
    return change


def _with_more_noise(motion: Motion, rng: np.random.Generator) -> Motion:
    """Return a motion with as much white noise of angles and speeds again."""
    samples = motion.samples
    q = samples.q + rng.standard_normal(samples.q.shape) * _angle_noise(samples)
    qd = samples.qd + rng.standard_normal(samples.q.shape) * motion.speed_noise
    return replace(motion, samples=replace(samples, q=q, qd=qd),
                   memo={'speed noise': motion.speed_noise})


def _angle_noise(samples: JointSamples) -> FloatArray:
    """Return the standard deviation (M, N) in rad of the white noise of angles, by run."""
    noise = np.zeros_like(samples.q)
    for run in run_slices(samples):
        noise[run] = white_noise([(samples.q[run], samples.t[run])])
    return noise
