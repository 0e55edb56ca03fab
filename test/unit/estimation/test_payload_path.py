"""Payload path: the first payload determines the direction of later changes."""

from dataclasses import replace

from bench.cases.generated import generated_arm, small_motion
from bench.shared.campaign import campaign
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.payload_path import path_moments, payload_path
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.simulation.arms import gravity_torque, Payload, with_payload
import numpy as np
import pytest

FIRST, SECOND = Payload(2.0, (0.02, -0.01, 0.1)), Payload(0.9, (-0.03, 0.02, 0.06))


def samples(arm, seed, start, duration, payload=None):
    motion = small_motion(arm, seed, duration, 5.0, start)
    carried = arm if payload is None else with_payload(arm, payload)
    noise = 0.1 * np.random.default_rng([seed, int(start)]).normal(size=motion.q.shape)
    return JointSamples.single_run(arm.joints, motion.t, motion.q, motion.qd,
                                   gravity_torque(carried, motion.q) + noise)


@pytest.fixture(scope='module', params=[0, *campaign(1, 2)])
def learned(request):
    """Return an arm, its seed, and its models without payload and with the first one."""
    seed = request.param
    arm = generated_arm(seed, right_angles=True)
    bare = fit(samples(arm, seed, 0.0, 100.0), FitOptions('chain')).model
    return arm, seed, bare, update(bare, samples(arm, seed, 100.0, 60.0, FIRST)).model


def error(model, arm, payload):
    q = np.random.default_rng(3).uniform(model.coverage.q_min, model.coverage.q_max,
                                         (500, arm.n_joints))
    difference = model.predict(q) - gravity_torque(with_payload(arm, payload), q)
    return np.sqrt((difference ** 2).mean(axis=0)).max()


def test_the_path_has_the_torque_of_the_payload(learned):
    arm, _, bare, first = learned
    assert bare.payload_path is None
    box = np.stack([bare.coverage.q_min, bare.coverage.q_max])
    moments = path_moments(first.payload_path, first.chain, box)
    q = np.random.default_rng(4).uniform(box[0], box[1], (200, arm.n_joints))
    columns = np.eye(2 * arm.n_joints)
    change = sum(x * replace(first.chain, moments=unit.reshape(-1, 2)).torque(q)
                 for x, unit in zip(moments, columns))
    true = gravity_torque(with_payload(arm, FIRST), q) - gravity_torque(arm, q)
    assert np.sqrt(((change - true) ** 2).mean(axis=0)).max() < 0.2


@pytest.mark.campaign
def test_the_next_payload_requires_less_motion():
    with_path, without = [], []
    for seed in range(6):
        arm = generated_arm(seed, right_angles=True)
        bare = fit(samples(arm, seed, 0.0, 100.0), FitOptions('chain')).model
        first = update(bare, samples(arm, seed, 100.0, 60.0, FIRST)).model
        short = samples(arm, seed, 160.0, 8.0, SECOND)
        with_path.append(error(update(first, short).model, arm, SECOND))
        without.append(error(update(replace(first, payload_path=None), short).model, arm, SECOND))
    assert max(with_path) < 0.2 and np.mean(with_path) < 0.8 * np.mean(without)


def test_the_larger_change_is_kept_and_saved(learned, tmp_path):
    arm, seed, bare, first = learned
    second = update(first, samples(arm, seed, 160.0, 20.0, SECOND)).model
    np.testing.assert_array_equal(second.payload_path.weights, first.payload_path.weights)
    save_model(tmp_path / 'm.json', second)
    read = load_model(tmp_path / 'm.json')
    np.testing.assert_array_equal(read.payload_path.indices, second.payload_path.indices)
    np.testing.assert_array_equal(read.payload_path.weights, second.payload_path.weights)
    # A change within the noise is not kept.
    assert payload_path(bare, update(bare, samples(arm, seed, 100.0, 20.0)).model) is None
