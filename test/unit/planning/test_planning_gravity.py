"""Standard deviation of the gravity torque before and after a planned motion."""

from bench.shared.planning_arm import model, NAMES, one_way
from gravity_comp_ros.estimation.estimate import estimate, FitOptions
from gravity_comp_ros.estimation.estimated_model import model_of, Switches
from gravity_comp_ros.planning import plan, PlanOptions
from gravity_comp_ros.planning.criterion import GravityQuestion
from gravity_comp_ros.planning.questions import named_targets
from gravity_comp_ros.planning.sums import PlannedMotion, Sums
import numpy as np
import pytest

WIDE = PlanOptions(20.0, low=np.full(3, -1.2), high=np.full(3, 1.2), reach=np.inf)


@pytest.fixture(scope='module')
def estimated():
    return estimate(one_way(0, span=0.3), FitOptions('chain'), old=model())


def test_the_uncertainty_is_that_of_the_model(estimated):
    old = one_way(0, span=0.3)
    planned = PlannedMotion(estimated.regression)
    question = GravityQuestion.of(Sums(planned, estimated.regression.terms, 20.0), True)
    std = model_of(estimated, Switches()).predict_std(old.q)
    np.testing.assert_allclose(question.std, np.sqrt((std ** 2).mean(axis=0)), rtol=0.05)
    assert question.joints == tuple(np.argsort(-question.std))


def test_a_plan_reduces_the_uncertainty(estimated):
    planned = plan(one_way(0, span=0.3), model(), named_targets(['gravity'], NAMES), WIDE,
                   estimated=estimated)
    assert {each.joint for each in planned.gravity} == set(NAMES) and not planned.expectations
    assert all(each.after < each.before for each in planned.gravity)
    assert any('gravity' in part.settles for part in planned.parts)
    assert 'uncertain by' in planned.gravity[0].sentence and planned.to_json()['gravity']


def test_the_uncertainty_after_is_that_of_the_posterior(estimated):
    regression = estimated.regression
    sums = Sums(PlannedMotion(regression), regression.terms, 1e-9)
    question = GravityQuestion.of(sums, True)
    # Without a motion it is the published posterior.
    after = question.std_after(sums, sums.recorded[None])[0]
    np.testing.assert_allclose(after, question.std, rtol=1e-6)
    more = question.std_after(sums, 4.0 * sums.recorded[None])[0]
    assert (more < 0.75 * after).all()
