"""Inertia as a nuisance term of slow motion, and friction near reversals after an update."""

from dataclasses import replace
from functools import cache

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.data.acceleration import accelerations
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.inertia import inertia_of
from gravity_comp_ros.estimation.nuisance_columns import nuisance_torque, reversal_std
from gravity_comp_ros.models.nuisance import COULOMB, INERTIA, NuisanceTerm, NuisanceTerms
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7
from gravity_comp_ros.simulation.noise import NoiseOptions
from gravity_comp_ros.simulation.synthesise import synthesise, SynthesisOptions
import numpy as np
import pytest

ARM = iiwa7()


@cache
def recording(seed):
    """Return a minute of slow motion with all rigid-body torque and 0.1 N·m of noise."""
    motion = motions.multisine(ARM.lower, ARM.upper, ARM.max_speed, seed,
                               motions.MultisineOptions(0.12), 60.0, 20.0)
    return Recording(synthesise(ARM, motion, SynthesisOptions(NoiseOptions(0.0, 0.1), seed)))


def error(model):
    """Return the RMS error (N,) in N·m of gravity over the range of the motion."""
    q = np.random.default_rng(0).uniform(model.coverage.q_min, model.coverage.q_max, (300, 7))
    return np.sqrt(((model.predict(q) - gravity_torque(ARM, q)) ** 2).mean(axis=0))


def test_gravity_is_more_accurate_with_inertia_terms():
    """The first axis is vertical: only a tilt of the base explains its inertia as gravity."""
    without, with_terms = [], []
    for seed in range(60, 70):
        slow = recording(seed).slow
        without.append(error(fit(replace(slow, qdd=None)).model))
        result = fit(slow)
        with_terms.append(error(result.model))
        inertia = result.model.nuisance.of(INERTIA)
        # The sum of the links' inertia about the axis, 1 to 5 kg·m², by posture.
        assert all(0.5 < inertia[name].value < 8.0 for name in inertia
                   if name in ARM.joints[:2])
    without, with_terms = np.array(without), np.array(with_terms)
    assert np.median(with_terms.max(axis=1)) < 0.7 * np.median(without.max(axis=1))
    assert with_terms[:, 0].max() < 0.05 < without[:, 0].max()


def test_quick_starts_and_slow_rates_have_no_inertia_in_slow_motion():
    samples = recording(60).samples
    qdd = accelerations(samples)
    qdd[7, 2] = 0.5
    inertia = inertia_of(samples, qdd)
    assert not inertia.is_coupled and inertia.sources(3) == [3]
    expected = qdd.copy()
    expected[7] = 0.0
    np.testing.assert_array_equal(inertia.qdd, expected)
    slow = Recording(replace(recording(60).slow, qdd=None)).slow
    assert slow.qdd is None
    assert not fit(slow).model.nuisance.of(INERTIA)


def test_torque_of_inertia_uses_the_given_accelerations():
    samples = recording(60).samples
    samples = replace(samples, qdd=np.full((len(samples), 7), 0.2))
    term = NuisanceTerm(INERTIA, ARM.joints[1], 2.0, 0.1, ARM.joints[1])
    nuisance = NuisanceTerms((term,), np.full(7, 0.01), np.zeros(7), np.full(7, 0.1))
    torque = nuisance_torque(nuisance, samples)
    np.testing.assert_allclose(torque[:, 1], 0.4)
    assert not torque[:, [0, 2, 3, 4, 5, 6]].any()
    assert not nuisance.without(INERTIA).terms


@pytest.mark.parametrize('ramp, far', [(0.0, 0.1), (1.0, 0.07)])
def test_friction_is_uncertain_near_reversals_only(ramp, far):
    speeds = np.array([0.0, 0.02, far, -0.02])
    samples = JointSamples.single_run(('a', 'b'), np.arange(4.0), np.zeros((4, 2)),
                                      np.column_stack([speeds, speeds]), np.zeros((4, 2)))
    nuisance = NuisanceTerms((NuisanceTerm(COULOMB, 'a', 3.0, 0.1),), np.full(2, 0.02),
                             np.zeros(2), np.full(2, 0.1), np.full(2, ramp))
    std = reversal_std(nuisance, samples)
    slow, quick = (0.5, 0.825) if ramp else (np.tanh(1.0), np.tanh(1.65))
    slow = 0.5 / 1.65 if ramp else np.tanh(1.0 / 1.65)
    assert std[1, 0] == std[3, 0] == pytest.approx(1.5 * (quick - slow))
    assert std[0, 0] == 0.0 and std[2, 0] < 0.05 and not std[:, 1].any()
