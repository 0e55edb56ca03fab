"""Offsets of a fit that starts from a chain without: only if they reduce the residual."""

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.formulation_choice import choose
from gravity_comp_ros.estimation.regression import build_regression
from gravity_comp_ros.models.nuisance import OFFSET
from gravity_comp_ros.models.sparse.sparse_problem import SparseOptions
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pytest
from serial_arms import poses, serial_arm

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
    assert not model.nuisance.of(OFFSET)
    return model


def offsets_of(choice) -> dict[int, float]:
    """Return the offsets of a choice in N·m, by joint number."""
    estimate = choice.estimate
    return {c.joint: float(x) for c, x in zip(estimate.regression.nuisance.columns,
                                              estimate.coefficients) if c.kind == OFFSET}


@pytest.mark.parametrize('offset, kept', [(0.03, False), (0.5, True)])
def test_a_chain_without_offsets_gets_only_relevant_ones(old, offset, kept):
    """Both offsets are significant, but the smaller one hardly reduces the residual."""
    regression = build_regression(recorded(offset, 2))
    standard = choose(regression, SparseOptions(), start=old.chain)
    assert offsets_of(standard)[ELBOW] == pytest.approx(offset, abs=0.03)
    simpler = choose(regression, SparseOptions(), start=old.chain, no_offsets=True)
    assert simpler.formulation == 'chain'
    assert ('without an offset' in simpler.why) == (not kept)
    if kept:
        assert offsets_of(simpler) == pytest.approx(offsets_of(standard))
    else:
        assert not offsets_of(simpler)
        for choice in (standard, simpler):
            rms = np.sqrt((choice.estimate.residual() ** 2).mean(axis=0))
            assert rms == pytest.approx(np.full(4, NOISE), rel=0.1)


@pytest.mark.parametrize('offset', [0.03, 0.5])
def test_a_fit_considers_whether_the_old_chain_had_offsets(old, offset):
    """The fit that starts from it has an offset only if that is relevant."""
    offsets = fit(recorded(offset, 2), old=old).model.nuisance.of(OFFSET)
    assert set(offsets) == ({ARM.joints[ELBOW]} if offset == 0.5 else set())


@pytest.mark.parametrize('formulation', ['per_joint', 'potential', 'chain'])
def test_the_report_names_the_formulation_of_the_model(formulation):
    result = fit(recorded(0.0, 0), FitOptions(formulation))
    assert result.report.choice.formulation == result.model.formulation == formulation
