"""
Weights of the joints: noise, autocorrelation and discrepancy of the residual.

The variance of a sum of scores is that of noise, plus that of a model error of fixed size that
repeats with the motion:

    1 / precision = sigma^2 tau + (eta s)^2 R

with R rows, eta the discrepancy and s the torque scale of the joint. tau is the autocorrelation
time of the residual. It is 1 while terms are selected, because the residual of an incomplete model
is autocorrelated by what is missing; the scatter of a term's own scores replaces it (`gains`).
The published covariance contains it.

These weights are those of the evidence of a term: a model error could have its shape. It cannot
have the shape of all columns at once, so coefficients are estimated with the weights of the noise
alone, `white_precision`.

Angles and speeds have noise too. Friction reverses over a distance that may be as short as that of
an encoder, so that a row with a reversal has a much larger error than the others (W. A. Fuller,
Measurement Error Models, 1987). Its variance is that over draws of the noise.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_direction import white_noise
from gravity_comp_ros.models.noise import correlation_time, growth, WHITE
from gravity_comp_ros.regression.candidates import TermFactory
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.posterior import Posterior
from gravity_comp_ros.regression.prior import Scale
import numpy as np

# Relative change of the weights below which the noise has converged, and maximum number of its
# estimates.
CONVERGED, MAX_NOISES = 0.05, 8
# Number of draws of the noise of the measured motion.
_DRAWS = 4


def noise_std(posterior: Posterior, scale: Scale, options: EngineOptions) -> FloatArray:
    """Return each joint's standard deviation (N,) of the residual of a row, N·m."""
    variance = posterior.squares / posterior.design.n_rows
    return np.asarray(np.sqrt(variance + (options.floor * scale.torque) ** 2))


def precision_of(posterior: Posterior, scale: Scale, options: EngineOptions,
                 times: FloatArray | None = None) -> FloatArray:
    """
    Return the weight (N,) of a squared residual of each joint, 1 / (N·m)^2.

    :param times: autocorrelation times (N,) of the residuals in rows; 1 by default.
    """
    variance = noise_std(posterior, scale, options) ** 2
    if times is not None:
        variance = variance * times
    discrepancy = (options.discrepancy * scale.torque) ** 2 * posterior.design.n_rows
    return np.asarray(1.0 / (variance + discrepancy))


def white_precision(posterior: Posterior, scale: Scale, options: EngineOptions) -> FloatArray:
    """Return the weight (N,) of a squared residual of each joint by its noise alone."""
    return np.asarray(noise_std(posterior, scale, options) ** -2.0)


def correlation_times(posterior: Posterior) -> FloatArray:
    """Return the autocorrelation time of each joint's residual, (N,) in rows."""
    design = posterior.design
    return np.array([correlation_time(posterior.residual(j), design.rows.run)
                     for j in range(design.n_joints)])


def relative_weights(residual: FloatArray, gravity: FloatArray) -> FloatArray:
    """
    Return weights (R, N) for noise that grows with the torque (`models.noise`), with a mean of 1.

    They are 1 where the residual is not white: the error of a wrong model grows with the torque as
    well.

    :param residual: (R, N) in N·m. :param gravity: (R, N) in N·m.
    """
    weights = np.ones_like(residual)
    for j, (r, g) in enumerate(zip(residual.T, gravity.T)):
        if correlation_time(r, np.zeros(len(r), dtype=np.int64)) < WHITE:
            weights[:, j] = 1.0 / (1.0 + growth(r, g) * g ** 2 / max((g ** 2).mean(), 1e-300))
            weights[:, j] /= weights[:, j].mean()
    return weights


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
