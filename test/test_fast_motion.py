"""Gravity of fast motion, beside rigid-body dynamics, judged over the whole joint range."""

from bench.planning.scenes import known_axes
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.estimation.fast_motion import fit_gravity
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.estimation.refit import refit
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7
from gravity_comp_ros.simulation.disturbances.friction import Friction
from gravity_comp_ros.simulation.disturbances.lugre import LuGre
from gravity_comp_ros.simulation.noise import NoiseOptions
from gravity_comp_ros.simulation.synthesise import synthesise, SynthesisOptions
import numpy as np
import pytest

ARM = iiwa7()


def recorded(seed, speed, band, friction=0.0):
    """Return 60 s of all joints, as fast as `speed` rad/s."""
    motion = motions.multisine(0.6 * ARM.lower, 0.6 * ARM.upper, np.full(7, speed), seed,
                               motions.MultisineOptions(band, 60.0), 60.0, 50.0)
    rubs = tuple(Friction(n, LuGre(friction, friction)) for n in range(7) if friction)
    return synthesise(ARM, motion, SynthesisOptions(NoiseOptions(0.0, 0.1), seed,
                                                    disturbances=rubs))


def worst(model):
    """Return the RMS error of gravity over the joint range, of the worst joint, N·m."""
    q = np.random.default_rng(0).uniform(ARM.lower, ARM.upper, (500, 7))
    return np.sqrt(((model.predict(q) - gravity_torque(ARM, q)) ** 2).mean(axis=0)).max()


@pytest.mark.parametrize('known, seed, most', [
    (True, 0, 0.03), (True, 7, 0.05), (False, 0, 0.06), (False, 7, 0.1)])
def test_gravity_does_not_bend_towards_the_torque_of_motion(known, seed, most):
    options = FitOptions(geometry=known_axes(ARM) if known else None)
    samples = recorded(seed, 1.0, 0.3)
    found = fit_gravity(samples, options)
    assert worst(found.model) < most
    # Rows of inertia, one for each joint, are not enough.
    assert worst(fit(samples, options).model) > 3.0 * worst(found.model)
    # The torque of motion is a nuisance term: nothing of it is predicted.
    assert not found.model.applied.effects and found.report.known_axes == known
    assert found.report.choice.why.endswith('rigid-body dynamics was fitted beside it')
    left = samples.tau - found.model.predict(samples.q)
    np.testing.assert_allclose(list(found.report.rmse.values()),
                               np.sqrt((left ** 2).mean(axis=0)), rtol=1e-9)


def test_effects_that_are_added_leave_gravity_right():
    samples = recorded(3, 1.0, 0.8, friction=1.0)
    model = fit_gravity(samples, FitOptions(geometry=known_axes(ARM))).model
    added = refit(samples, model, requests(['coulomb_friction'], samples.names))
    assert worst(added.model) < 0.1
    assert {e.name for e in added.model.applied.effects} == {'coulomb_friction'}


def test_slow_motion_is_fitted_as_before():
    samples = recorded(0, 0.1, 0.05)
    first, found = fit(samples), fit_gravity(samples)
    q = samples.q[::10]
    np.testing.assert_array_equal(found.model.predict(q), first.model.predict(q))
    assert 'rigid-body' not in found.report.choice.why
