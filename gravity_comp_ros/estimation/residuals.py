"""Residuals of a regression, and torques without some of its terms."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.regression.engine import Regression
from gravity_comp_ros.regression.problem import Problem
import numpy as np


def samples_of_rows(problem: Problem, torque: FloatArray) -> JointSamples:
    """Return the means over rows as samples, with a torque (R, N) in N·m."""
    samples, rows = problem.samples, problem.rows
    return JointSamples(samples.names, rows.t, rows.mean(samples.q), rows.mean(samples.qd),
                        torque, rows.run, samples.run_labels)


def is_white(regression: Regression, limit: float) -> bool:
    """Return whether every joint's residual is close to the white noise of its torque."""
    return bool((regression.noise <= limit * regression.problem.white_noise).all())


def held_out_ratio(regression: Regression, sigma: FloatArray) -> float:
    """Return the RMS of the held-out residuals of all joints, in multiples of sigma (N,)."""
    squares = np.zeros(len(sigma))
    fold = regression.problem.rows.fold
    for k in np.unique(fold):
        without = regression.without(fold == k)
        squares += [float((without.residual(j) ** 2).sum()) for j in range(len(sigma))]
    return float(np.sqrt((squares / len(fold) / sigma ** 2).mean()))


def torque_at_rest(regression: Regression) -> FloatArray:
    """
    Return the torque of the rows without dynamics and effects of motion, (R, N) in N·m.

    Static effects are included: those of a wrong gravity explain what it misses.
    """
    problem, posterior = regression.problem, regression.posterior
    gravity = regression.shared.gravity(problem.samples.q)
    torque = problem.rows.mean(gravity) + posterior.unweighted_residual()
    for term in posterior.terms:
        if term.effect.is_static:
            for j in term.joints(posterior.design.n_joints):
                torque[:, j] += term.on(j) @ posterior.beta[posterior.at[term]]
    return torque
