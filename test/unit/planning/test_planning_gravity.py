"""Standard deviation of the gravity torque before and after a planned motion."""

from bench.shared.planning_arm import model, NAMES, one_way
from gravity_comp_ros.estimation.estimate import estimate, FitOptions
from gravity_comp_ros.estimation.estimated_model import model_of, Switches
from gravity_comp_ros.planning import plan, PlanOptions
from gravity_comp_ros.planning.criterion import Gravity
from gravity_comp_ros.planning.questions import named_targets
import numpy as np
import pytest

WIDE = PlanOptions(20.0, low=np.full(3, -1.2), high=np.full(3, 1.2), reach=np.inf)


@pytest.fixture(scope='module')
def estimated():
    return estimate(one_way(0, span=0.3), FitOptions('chain'), old=model())


def test_the_uncertainty_is_that_of_the_model(estimated):
    old = one_way(0, span=0.3)
    question = Gravity.of(estimated.regression, True)
    std = model_of(estimated, Switches()).predict_std(old.q)
    np.testing.assert_allclose(question.now, np.sqrt((std ** 2).mean(axis=0)), rtol=0.05)
    assert question.joints == tuple(np.argsort(-question.now))


def test_a_plan_reduces_the_uncertainty(estimated):
    planned = plan(one_way(0, span=0.3), model(), named_targets(['gravity'], NAMES), WIDE,
                   estimated=estimated)
    assert {each.joint for each in planned.gravity} == set(NAMES) and not planned.expectations
    assert all(each.after < each.before for each in planned.gravity)
    assert any('gravity' in part.settles for part in planned.parts)
    assert 'uncertain by' in planned.gravity[0].sentence and planned.to_json()['gravity']


def test_more_motion_reduces_the_uncertainty(estimated):
    question = Gravity.of(estimated.regression, True)
    # Without a motion it is the published posterior.
    now, after = question.std(question.sums.recorded * np.array([1.0, 4.0])[:, None, None])
    np.testing.assert_allclose(now, question.now, rtol=1e-6)
    assert (after < 0.75 * now).all()
