"""Torque of motion in slow motion, and friction near reversals after an update."""


from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.update import reversal_std
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse.dictionary import Expansion
import numpy as np
import pytest


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
