"""Gravity that the model is unsure of: what a motion does about it."""

from gravity_comp_ros.diagnosis.findings import Diagnosis, JointReport
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.planning import plan, PlanOptions
from gravity_comp_ros.planning.gravity_doubt import gravity_doubt
from gravity_comp_ros.planning.questions import named_targets
import numpy as np
from planning_arm import CHAIN, model, NAMES, NOISE, one_way, unsure_model
import pytest


def rms(std):
    return np.sqrt((std ** 2).mean(axis=0))


def test_the_doubt_is_that_of_the_model():
    old = one_way(0)
    doubt = gravity_doubt(unsure_model(), old.q, old.tau, np.full(3, NOISE))
    answer = doubt.answer(doubt.nothing())
    poses = old.q[np.unique(np.linspace(0, len(old.q) - 1, 300).round().astype(int))]
    std = rms(unsure_model().predict_std(poses))
    assert doubt.joints == tuple(np.argsort(-std))
    np.testing.assert_allclose(answer.std, std[list(doubt.joints)], rtol=0.02)
    np.testing.assert_array_equal(answer.std, answer.before)
    assert answer.value == pytest.approx(0.0) and doubt.cost == pytest.approx(std.max(), rel=0.02)


def test_information_is_that_of_least_squares():
    # Prior C, and rows of torque with nuisance terms: the posterior by normal equations.
    old, rng = one_way(1), np.random.default_rng(0)
    doubt = gravity_doubt(unsure_model(), old.q, old.tau, np.full(3, NOISE))
    q, own = rng.uniform(-1.0, 1.0, (50, 3)), rng.normal(size=(50, 3, 6))
    weights = np.array([400.0, 100.0, 900.0])
    answer = doubt.answer(doubt.information(q, own, weights))
    normal = np.zeros((12 + 18, 12 + 18))
    normal[:12, :12] += np.eye(12) / 0.2 ** 2
    normal[12:, 12:] += 1e-6 * np.eye(18)
    for n in range(3):
        rows = np.zeros((50, 30))
        rows[:, :12] = CHAIN.jacobian(q)[:, n].T
        rows[:, 12 + 6 * n:18 + 6 * n] = own[:, n]
        normal += weights[n] * rows.T @ rows
    posterior = np.linalg.inv(normal)[:12, :12]
    poses = old.q[np.unique(np.linspace(0, len(old.q) - 1, 300).round().astype(int))]
    columns = CHAIN.jacobian(poses)
    left = [np.sqrt(np.einsum('ip,ij,jp->p', columns[:, n], posterior, columns[:, n]).mean())
            for n in doubt.joints]
    np.testing.assert_allclose(answer.std, left, rtol=0.02)


def test_a_plan_makes_the_model_surer():
    old = one_way(0)
    found = plan(old, unsure_model(), named_targets(['gravity'], NAMES), PlanOptions(15.0))
    assert {each.joint for each in found.gravity} == set(NAMES) and not found.expectations
    assert all(each.after < 0.6 * each.before for each in found.gravity)
    assert any('gravity' in part.settles for part in found.parts)
    assert 'unsure by' in found.gravity[0].sentence and found.to_json()['gravity']
    with pytest.raises(OptionError, match='holds no uncertainty'):
        plan(old, model(), named_targets(['gravity'], NAMES), PlanOptions(15.0))


def test_by_default_gravity_is_asked_for_where_it_costs():
    nothing = Diagnosis((), dict.fromkeys(NAMES, JointReport('', NOISE, 100.0, 0.1, 0.1, {})))
    found = plan(one_way(0), unsure_model(), None, PlanOptions(15.0), nothing)
    costs = [each.before for each in found.gravity]
    assert costs == sorted(costs, reverse=True) and costs[0] > 0.1
    with pytest.raises(OptionError, match='nothing is left open'):
        plan(one_way(0), unsure_model(1e-4), None, PlanOptions(15.0), nothing)
