"""Tilt of the base on known axes: not due to inertia, and identified if present."""

from dataclasses import replace

from bench.planning.scenes import known_axes
from bench.shared.campaign import campaign
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import fit_model
from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.differentiation import accelerations
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.kinematic.nominal_arm import nominal_parameters
from gravity_comp_ros.models.kinematic.rigid_body import inverse_dynamics as torque_of
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import (
    gravity_torque, iiwa7, inverse_dynamics, with_base_tilt)
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np
import pytest

ARM = iiwa7()
AXES = known_axes(ARM)


def moved(seed, speed, band, arm=ARM, rate=50.0, noise=0.1):
    """Return a minute of a multisine, up to `speed` rad/s and `band` Hz."""
    motion = motions.multisine(0.6 * ARM.lower, 0.6 * ARM.upper, np.full(7, speed), seed,
                               motions.MultisineOptions(speed, 60.0, band), 60.0, rate)
    return motion, synthesise(arm, motion, SynthesisOptions(NoiseOptions(0.0, noise), seed))


def fitted(samples):
    """Return the result of the fit command, of the samples that pass the gate."""
    return fit_model(Recording(samples), FitOptions('chain', geometry=AXES))[0]


def error(model, arm):
    """Return the RMS error of gravity over the joint range, of the worst joint, N·m."""
    q = np.random.default_rng(0).uniform(ARM.lower, ARM.upper, (500, 7))
    return np.sqrt(((model.predict(q) - gravity_torque(arm, q)) ** 2).mean(axis=0)).max()


@pytest.mark.parametrize('seed', [0, *campaign(2, 3)])
def test_inertia_does_not_appear_as_a_tilt(seed):
    result = fitted(moved(seed, 0.15, 0.3)[1])
    assert result.report.base_tilt == 0.0
    assert error(result.model, ARM) < 0.3


@pytest.mark.parametrize('tilt', [5.0, *campaign(1.0, 3.0)])
def test_a_tilt_is_identified(tilt):
    arm = with_base_tilt(ARM, 0.8 * np.radians(tilt), 0.6 * np.radians(tilt))
    result = fitted(moved(3, 0.15, 0.3, arm)[1])
    assert np.degrees(result.report.base_tilt) == pytest.approx(tilt, abs=0.15)
    assert error(result.model, arm) < 0.3


def test_uneven_motion_uses_accelerations_of_the_whole_recording():
    motion, samples = moved(0, 0.15, 0.6)
    slow = Recording(samples).slow
    rows = np.searchsorted(samples.t, slow.t)
    own = accelerations(replace(slow, qdd=None))
    off, own_off = (np.abs(qdd - motion.qdd[rows]).max() for qdd in (slow.qdd, own))
    assert off < 0.005 and own_off > 0.02
    # A slow rate does not resolve them.
    assert Recording(replace(slow, qdd=None)).slow.qdd is None


def test_the_nominal_arm_models_most_of_the_torque_of_motion():
    motion, samples = moved(4, 0.15, 0.3, noise=0.0)
    chain = fit(samples, FitOptions('chain', geometry=AXES)).model.chain
    nominal = torque_of(AXES, samples.q, samples.qd, motion.qdd,
                        nominal_parameters(AXES, chain.moments / STANDARD_GRAVITY))
    torque = (inverse_dynamics(ARM, motion.q, motion.qd, motion.qdd)
              - gravity_torque(ARM, motion.q))
    assert np.sqrt(((nominal - torque) ** 2).mean()) < 0.1 * np.sqrt((torque ** 2).mean())
