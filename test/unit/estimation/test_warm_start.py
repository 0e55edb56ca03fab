"""A refit that starts from an old model: the same result for any old model."""

from dataclasses import replace

from bench.shared.serial_arms import poses, samples_of, serial_arm
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pytest

BOTH = pytest.mark.parametrize('formulation', ['potential', 'per_joint'])


def data(seed: int, arm_seed: int = 0):
    q = poses(150, 4, seed=seed)
    return samples_of(q, gravity_torque(serial_arm(4, seed=arm_seed), q), 0.1)


def same(a, b) -> None:
    for one, other in zip(a.model.torques, b.model.torques):
        np.testing.assert_array_equal(one.indices, other.indices)
        np.testing.assert_allclose(one.weights, other.weights, atol=1e-3)


@BOTH
@pytest.mark.parametrize('arm_seed', [0, 1])
def test_the_result_does_not_depend_on_the_start(formulation, arm_seed):
    # The old model is of this arm, or of a different one.
    old = fit(data(5, arm_seed), FitOptions(formulation)).model
    cold, warm = (fit(data(0), FitOptions(formulation), old=start) for start in (None, old))
    same(cold, warm)


def test_a_start_from_the_same_arm_takes_fewer_rounds():
    old = fit(data(5)).model if FitOptions().formulation == 'potential' else fit(
        data(5), FitOptions('potential')).model
    cold, warm = (fit(data(0), FitOptions('potential'), old=start) for start in (None, old))
    assert warm.report.solver[0].rounds <= cold.report.solver[0].rounds


@BOTH
def test_an_empty_model_or_one_of_other_joints_is_ignored(formulation):
    cold = fit(data(0), FitOptions(formulation))
    nothing = Expansion(np.zeros(0, dtype=np.int64), np.zeros(0))
    other = replace(cold.model, energy=nothing if cold.model.energy is not None else None,
                    torques=(nothing,) * 4)
    same(cold, fit(data(0), FitOptions(formulation), old=other))
    renamed = replace(cold.model, joints=('a', 'b', 'c', 'd'))
    same(cold, fit(data(0), FitOptions(formulation), old=renamed))
