"""Torque variance by the noise of angles and speeds, by hand and compared with true errors."""

from bench.shared.regression_cases import motion_of_joints, OwnGravity, with_torque
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.effects.presliding import presliding_state
from gravity_comp_ros.effects.request import known_effect
from gravity_comp_ros.regression.linear import Linear
from gravity_comp_ros.regression.measured_motion import variance_by_motion
from gravity_comp_ros.regression.problem import Problem
import numpy as np
import pytest

ANGLE, SPEED = 2e-5, 1e-3


def measured(seed, torque):
    """Return samples at 50 Hz, true and with noisy angles and speeds."""
    rng, runs = np.random.default_rng(seed), motion_of_joints(1, seed, rate=50.0)
    true = with_torque(runs, torque, seed, noise=1e-3)
    noisy = JointSamples(true.names, true.t, true.q + ANGLE * rng.standard_normal(true.q.shape),
                         true.qd + SPEED * rng.standard_normal(true.q.shape), true.tau,
                         true.runs, true.run_labels)
    return true, noisy


def fitted(samples, *terms):
    """Return the problem of samples linearised with some terms, (name, setting)."""
    problem, shared = Problem.of(samples), OwnGravity(np.array([4.0, -1.0]))
    factory = problem.factory(shared)
    return Linear.at(problem, shared, factory, tuple(
        factory.term(known_effect(name), 0, setting) for name, setting in terms), problem.weights)


def test_viscous_friction_by_hand():
    # The mean of five samples: (F sigma)^2 / 5.
    _, samples = measured(0, lambda q, qd, t: 4.0 * np.sin(q) - np.cos(q) + 2.0 * qd)
    fit = fitted(samples, ('viscous_friction', {}))
    variance = variance_by_motion(fit.posterior, fit.factory)
    assert variance.mean() == pytest.approx((2.0 * SPEED) ** 2 / 5.0, rel=0.1)


@pytest.mark.parametrize('seed', range(3))
def test_rows_with_a_reversal_have_the_error_of_friction(seed):
    def torque(q, qd, t):
        runs = np.split(q[:, 0], np.flatnonzero(np.diff(t) < 0.0) + 1)
        return (4.0 * np.sin(q) - np.cos(q) + np.concatenate(
            [presliding_state(run, 5e-5) for run in runs])[:, None])

    true, samples = measured(seed, torque)
    fit = fitted(samples, ('coulomb_friction', {'distance': 5e-5}))
    std = np.sqrt(variance_by_motion(fit.posterior, fit.factory))[:, 0]
    term, = fit.posterior.terms
    exact = term.effect.columns(Problem.of(true).motion, 0, term.setting)
    error = (term.columns - fit.problem.rows.mean(exact))[:, 0]
    uncertain = std > 0.02
    assert 0.005 < uncertain.mean() < 0.1
    assert np.abs(error[~uncertain]).max() < 0.1
    # The path without encoder noise leads by about its standard deviation, which no draw shows.
    ratio = np.sqrt((error[uncertain] ** 2).mean() / (std[uncertain] ** 2).mean())
    assert 0.4 < ratio < 3.0, ratio
