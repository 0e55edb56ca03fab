"""Offsets of a fit that starts from a chain without one, and the reported formulation."""

from bench.shared.serial_arms import poses, serial_arm
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pytest

ARM = serial_arm(4, 3)
NOISE = 0.1
ELBOW = 2


def recorded(offset: float, seed: int) -> JointSamples:
    """Return 400 poses with white noise, and an offset in N·m on the third joint."""
    q = poses(400, 4, seed)
    tau = gravity_torque(ARM, q) + NOISE * np.random.default_rng(seed).normal(size=q.shape)
    tau[:, ELBOW] += offset
    return JointSamples.single_run(ARM.joints, 0.2 * np.arange(len(q)), q, np.zeros_like(q), tau)


@pytest.fixture(scope='module')
def old():
    """Return a model whose chain was fitted without offsets."""
    model = fit(recorded(0.0, 1), FitOptions('chain')).model
    assert not model.fitted.effects and not model.applied.effects
    return model


def test_a_fit_that_starts_from_a_chain_without_offsets_finds_one(old):
    model = fit(recorded(0.5, 2), FitOptions('chain'), old=old).model
    effect, = (*model.fitted.effects, *model.applied.effects)
    assert effect.target == f'torque_offset:{ARM.joints[ELBOW]}'
    assert effect.coefficients['b'].value == pytest.approx(0.5, abs=0.03)
    assert model.residual_std == pytest.approx(np.full(4, NOISE), rel=0.1)


@pytest.mark.parametrize('formulation', ['per_joint', 'potential', 'chain'])
def test_the_report_names_the_formulation_of_the_model(formulation):
    result = fit(recorded(0.0, 0), FitOptions(formulation))
    assert result.report.choice.formulation == result.model.formulation == formulation
