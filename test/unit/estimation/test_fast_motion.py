"""Gravity from fast motion, fitted with rigid-body dynamics; errors over the joint range."""

from bench.planning.scenes import known_axes
from bench.shared.campaign import campaign
from bench.shared.fast_arms import moved, worst
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.simulation.arms import iiwa7
import numpy as np
import pytest

ARM = iiwa7()


@pytest.mark.parametrize('known, seed, limit', [
    (False, 0, 0.06), *campaign((True, 7, 0.05), (True, 0, 0.03), (False, 7, 0.1))])
def test_gravity_does_not_absorb_the_torque_of_motion(known, seed, limit):
    options = FitOptions(geometry=known_axes(ARM) if known else None)
    samples = moved(ARM, seed, 1.0, 0.3, 0.0, 60.0)
    result = fit(samples, options)
    assert worst(ARM, result.model) < limit
    # The torque of motion is fitted and not predicted.
    assert not result.model.applied.effects and result.report.known_axes == known
    residual = samples.tau - result.model.predict(samples.q)
    np.testing.assert_allclose(list(result.report.rmse.values()),
                               np.sqrt((residual ** 2).mean(axis=0)), rtol=1e-9)
