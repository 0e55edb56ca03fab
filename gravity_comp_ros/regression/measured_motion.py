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
from gravity_comp_ros.effects.motion_direction import white_noise
from gravity_comp_ros.regression.candidates import TermFactory
from gravity_comp_ros.regression.posterior import Posterior
import numpy as np

# Number of draws of the noise.
_DRAWS = 4


def variance_by_motion(posterior: Posterior, factory: TermFactory) -> FloatArray:
    """Return the variance (R, N) in (N·m)^2 of each row by the noise of the measured motion."""
    motion, noise = factory.motion, _angle_noise(factory.motion.samples)
    # At the present gravity: the columns of the posterior are of the step before.
    own = [factory.term(term.effect, term.joint, term.setting) for term in posterior.terms]
    variance = np.zeros((factory.rows.n_rows, posterior.design.n_joints))
    for seed in range(_DRAWS):
        drawn = _factory_of(_with_more_noise(motion, noise, np.random.default_rng(seed)), factory)
        change = np.zeros_like(variance)
        for term, clean in zip(posterior.terms, own):
            other = drawn.term(term.effect, term.joint, term.setting)
            for j in term.joints(posterior.design.n_joints):
                change[:, j] += (other.on(j) - clean.on(j)) @ posterior.beta[posterior.at[term]]
        variance += change ** 2 / _DRAWS
    return variance


def _factory_of(motion: Motion, other: TermFactory) -> TermFactory:
    return TermFactory(lambda: motion, other.rows, other.scale)


def _with_more_noise(motion: Motion, noise: FloatArray, rng: np.random.Generator) -> Motion:
    """Return a motion with as much white noise of angles (M, N) in rad and of speeds again."""
    samples = motion.samples
    q = samples.q + rng.standard_normal(samples.q.shape) * noise
    qd = samples.qd + rng.standard_normal(samples.q.shape) * motion.speed_noise
    return replace(motion, samples=replace(samples, q=q, qd=qd),
                   memo={'speed noise': motion.speed_noise})


def _angle_noise(samples: JointSamples) -> FloatArray:
    """Return the standard deviation (M, N) in rad of the white noise of angles, by run."""
    noise = np.zeros_like(samples.q)
    for run in run_slices(samples):
        noise[run] = white_noise([(samples.q[run], samples.t[run])])
    return noise
