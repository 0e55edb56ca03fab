"""Standard deviation of the gravity torque before and after a planned motion."""

from gravity_comp_ros.diagnosis.findings import Diagnosis, JointReport
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.planning import plan, PlanOptions
from gravity_comp_ros.planning.gravity_uncertainty import gravity_uncertainty
from gravity_comp_ros.planning.targets import named_targets
import numpy as np
from planning_arm import CHAIN, model, NAMES, NOISE, one_way, uncertain_model
import pytest


def rms(std):
    return np.sqrt((std ** 2).mean(axis=0))


def test_the_uncertainty_is_that_of_the_model():
    old = one_way(0)
    uncertainty = gravity_uncertainty(uncertain_model(), old.q, old.tau, np.full(3, NOISE))
    score = uncertainty.score(uncertainty.zero_information())
    poses = old.q[np.unique(np.linspace(0, len(old.q) - 1, 300).round().astype(int))]
    std = rms(uncertain_model().predict_std(poses))
    assert uncertainty.joints == tuple(np.argsort(-std))
    np.testing.assert_allclose(score.std, std[list(uncertainty.joints)], rtol=0.02)
    np.testing.assert_array_equal(score.std, score.before)
    assert score.utility == pytest.approx(0.0)
    assert score.before.max() == pytest.approx(std.max(), rel=0.02)


def test_information_is_that_of_least_squares():
    # Posterior of prior C and rows of torque with nuisance terms, by normal equations.
    old, rng = one_way(1), np.random.default_rng(0)
    uncertainty = gravity_uncertainty(uncertain_model(), old.q, old.tau, np.full(3, NOISE))
    q, own = rng.uniform(-1.0, 1.0, (50, 3)), rng.normal(size=(50, 3, 6))
    weights = np.array([400.0, 100.0, 900.0])
    score = uncertainty.score(uncertainty.information(q, own, weights))
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
    std = [np.sqrt(np.einsum('ip,ij,jp->p', columns[:, n], posterior, columns[:, n]).mean())
           for n in uncertainty.joints]
    np.testing.assert_allclose(score.std, std, rtol=0.02)


def test_a_plan_reduces_the_uncertainty():
    old = one_way(0)
    planned = plan(old, uncertain_model(), named_targets(['gravity'], NAMES), PlanOptions(15.0))
    assert {each.joint for each in planned.gravity} == set(NAMES) and not planned.expectations
    assert all(each.after < 0.6 * each.before for each in planned.gravity)
    assert any('gravity' in part.settles for part in planned.parts)
    assert 'uncertain by' in planned.gravity[0].sentence and planned.to_json()['gravity']
    with pytest.raises(OptionError, match='has no uncertainty'):
        plan(old, model(), named_targets(['gravity'], NAMES), PlanOptions(15.0))


def test_uncertain_gravity_is_a_default_target():
    nothing = Diagnosis((), dict.fromkeys(NAMES, JointReport('', NOISE, 100.0, 0.1, 0.1, {})))
    planned = plan(one_way(0), uncertain_model(), None, PlanOptions(15.0), nothing)
    stds = [each.before for each in planned.gravity]
    assert stds == sorted(stds, reverse=True) and stds[0] > 0.1
    with pytest.raises(OptionError, match='no target is open'):
        plan(one_way(0), uncertain_model(1e-4), None, PlanOptions(15.0), nothing)
