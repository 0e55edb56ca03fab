"""Torque of motion in slow motion, and friction near reversals after an update."""

from functools import cache

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import fit_model
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.update import reversal_std
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
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


@pytest.mark.campaign
@pytest.mark.parametrize('seed', range(60, 65))
def test_gravity_does_not_absorb_the_inertia_of_slow_motion(seed):
    """The first axis is vertical: only a tilt of the base explains its inertia as gravity."""
    errors = error(fit_model(recording(seed))[0].model)
    assert errors[0] < 0.05 and errors.max() < 0.25


NO_ENERGY = Expansion(np.zeros(0, dtype=np.int64), np.zeros(0))


@pytest.mark.parametrize('law', [{'width': 0.02}, {'ramp': 0.02}])
def test_friction_is_uncertain_near_reversals_only(law):
    speeds = np.array([0.0, 0.02, 0.1, -0.02])
    samples = JointSamples.single_run(('a', 'b'), np.arange(4.0), np.zeros((4, 2)),
                                      np.column_stack([speeds, speeds]), np.zeros((4, 2)))
    friction = AppliedEffect('coulomb_friction', 'a', law, {
        'F_c': Value(3.0, 'N·m', (2.8, 3.2))})
    model = GravityModel(('a', 'b'), 'potential', (NO_ENERGY, NO_ENERGY), NO_ENERGY, np.zeros(2),
                         Coverage(np.zeros(2), np.zeros(2), 4), fitted=Applied((friction,)))
    std = reversal_std(model, samples)
    # The speed of the reversal changes by the factor 1.8 with the payload.
    slow, quick = (1.0 / 1.8, 1.0) if 'ramp' in law else (np.tanh(1.0 / 1.8), np.tanh(1.8))
    assert std[1, 0] == std[3, 0] == pytest.approx(1.5 * (quick - slow))
    assert std[0, 0] == 0.0 and std[2, 0] < 0.05 and not std[:, 1].any()
