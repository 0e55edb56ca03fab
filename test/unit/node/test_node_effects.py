"""Effects in the node: fitted on request, kept after a tool change, published if static."""

from dataclasses import replace
import time

from bench.shared.node_messages import joint_state, refit, send_message, until
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.node.checks import DIAGNOSIS
from gravity_comp_ros.node.diagnostics import ERROR, OK, WARN
from gravity_comp_ros.node.model_in_use import ModelInUse
import numpy as np
import pytest

FRICTION = 1.5
MASS = np.array([5.0, 2.0])
# Factor of each joint with a payload; not the same on both.
LOADED = np.array([1.5, 1.8])


def motion(t):
    """Return pose and speed of both joints (M, 2) in slow motion with reversals."""
    q = np.stack([0.6 * np.sin(0.2 * t), 0.5 * np.cos(0.23 * t)], axis=-1)
    qd = np.stack([0.12 * np.cos(0.2 * t), -0.115 * np.sin(0.23 * t)], axis=-1)
    return q, qd


def gravity(q, mass=1.0):
    """Return the torque of two links in an upright plane."""
    moments = mass * MASS
    both = moments[1] * np.sin(q.sum(axis=-1))
    return np.stack([moments[0] * np.sin(q[..., 0]) + both, both], axis=-1)


def torque(q, qd, mass=1.0):
    """Return gravity, with Coulomb friction on the first joint."""
    tau = gravity(q, mass)
    tau[..., 0] += FRICTION * np.tanh(qd[..., 0] / 0.005)
    return tau


def feed(node, start, n, mass=1.0):
    """Send n slow joint states from time `start`; return the time after them, and the torque."""
    rng = np.random.default_rng(int(start))
    for k in range(n):
        t = start + 0.2 * k
        q, qd = motion(t)
        tau = torque(q, qd, mass) + 0.05 * rng.standard_normal(2)
        result = send(node, t, q, qd, tau)
    return start + 0.2 * n, result


def send(node, t, q, qd=(), tau=()):
    return send_message(node, joint_state(['a', 'b'], t, q, qd, tau), t)[1]


@pytest.fixture(scope='module')
def model_file(tmp_path_factory):
    """Return the file of a model of gravity alone."""
    t = 0.2 * np.arange(400)
    q, qd = motion(t)
    tau = gravity(q) + 0.05 * np.random.default_rng(0).standard_normal(q.shape)
    path = tmp_path_factory.mktemp('effects') / 'model.json'
    save_model(path, fit(JointSamples.single_run(['a', 'b'], t, q, qd, tau)).model)
    return path


@pytest.fixture
def node(nodes, model_file):
    node = nodes.make(model_file=str(model_file), auto_fit=False, max_age=0.0, settle_time=0.0,
                      ramp_time=0.0, max_torque_rate=(), max_torque=(50.0,), full_samples=250)
    yield node
    nodes.close()


def change(node, **settings):
    node.set(replace(node.settings, **settings))


def test_a_per_joint_model_is_held_near_its_range():
    t = 0.2 * np.arange(400)
    q, qd = motion(t)
    samples = JointSamples.single_run(['a', 'b'], t, q, qd, gravity(q))
    for formulation, reach in (('per_joint', 0.1), ('potential', np.inf)):
        model = fit(samples, FitOptions(formulation)).model
        assert ModelInUse(model).reach == reach


def test_effects_are_fitted_on_request_and_friction_is_not_published(node):
    t, _ = feed(node, 1.0, 60)
    change(node, effects=('coulomb_friction:a',))
    success, text = refit(node)
    assert not success and 'coulomb_friction:a requires 100: keep moving' in text
    # The caller has the reply, and learning goes on.
    assert {s.name: s for s in node.statuses(t)}['learning'].level == OK
    t, _ = feed(node, t, 190)
    success, text = refit(node)
    assert success, text
    result = node.models.model.applied.effects[0]
    assert result.target == 'coulomb_friction:a'
    assert result.coefficients['F_c'].value == pytest.approx(FRICTION, rel=0.1)

    # Overcompensated friction destabilises an arm.
    q, qd = np.array([0.3, 0.2]), np.array([0.1, 0.1])
    np.testing.assert_allclose(send(node, t, q, qd, 0 * q), node.models.model.predict_one(q))


def test_diagnose_names_the_missing_effect(node):
    replies = []
    node.learner.request(DIAGNOSIS, time.monotonic(), lambda *reply: replies.append(reply))
    assert not replies[0][0] and 'no slow samples yet' in replies[0][1]
    feed(node, 1.0, 300)
    node.learner.request(DIAGNOSIS, time.monotonic(), lambda *reply: replies.append(reply))
    until(node, lambda: len(replies) == 2)
    assert replies[1][0] and 'coulomb_friction:a (established)' in replies[1][1]


def test_effects_stay_when_the_payload_changes(node):
    t, _ = feed(node, 1.0, 250)
    change(node, effects=('coulomb_friction:a',))
    assert refit(node)[0]
    node.learner.payload_changed(t)
    # In sixteen seconds the first joint moves over half of its range.
    t, _ = feed(node, t, 80, mass=LOADED)
    success, text = refit(node)
    assert success and 'change of the old model' in text, text
    applied = node.models.model.applied.effects
    assert [effect.target for effect in applied] == ['coulomb_friction:a']
    q = motion(np.array([3.0, 7.0, 11.0]))[0]
    np.testing.assert_allclose(node.models.model.predict(q), gravity(q, LOADED), atol=0.5)
    # The residual in diagnostics includes the effects of the model.
    t, _ = feed(node, t, 20, mass=LOADED)
    assert all(s.level == OK for s in node.statuses(t) if s.name.startswith('joint'))


def applied(name, joint, setting=None, **values):
    return AppliedEffect(name, joint, setting or {}, {
        symbol: Value(value, '', (value, value)) for symbol, value in values.items()})


SPRING = applied('joint_spring', 'b', {'centre': 0.1, 'overtones': 0.0}, k=2.0, m=0.0)


@pytest.mark.parametrize('setting, symbol', [({'width': 0.005}, 'F_old'), ({}, 'F_c')])
def test_a_model_with_an_effect_of_another_version_is_reported(model_file, nodes, tmp_path,
                                                               setting, symbol):
    """The node was not configured, without a status."""
    friction = applied('coulomb_friction', 'a', setting, **{symbol: FRICTION})
    save_model(path := tmp_path / 'model.json',
               replace(load_model(model_file), fitted=Applied((friction,))))
    node = nodes.make(model_file=str(path))
    status = {s.name: s for s in node.statuses(1.0)}['model']
    assert node.models.model is None and status.level == ERROR and path.name in status.message
    nodes.close()


@pytest.mark.parametrize('is_fitted', [False, True])
def test_the_residual_does_not_depend_on_the_count_of_revolutions(model_file, is_fitted, nodes,
                                                                  tmp_path):
    """A driver may count revolutions in another way after a start; a spring has no period."""
    effects = {'fitted' if is_fitted else 'applied': Applied((SPRING,))}
    save_model(path := tmp_path / 'model.json', replace(load_model(model_file), **effects))
    node = nodes.make(model_file=str(path), max_age=0.0, max_torque=(50.0,), auto_fit=False)
    in_use, seen = node.arm.in_use, []
    for k in range(40):
        # The second joint leaves the trained range in the last messages.
        q = np.array([0.3, 0.2 if k < 30 else 0.7])
        message = joint_state(['a', 'b'], 1.0 + 0.01 * k, q + [0.0, 2.0 * np.pi * (k >= 10)],
                              0 * q, gravity(q))
        reading, _ = send_message(node, message, 1.0 + 0.01 * k)
        np.testing.assert_allclose(reading.q, q, atol=1e-9)
        seen.append([in_use.predicted(reading), *in_use.residual(reading, gravity(q), 0 * q)])
        if k < 30:
            external = in_use.external_torque(reading)
    np.testing.assert_allclose(seen[:30], [seen[0]] * 30, atol=1e-9)
    assert np.abs(external.torque).max() < 0.3 and np.isfinite(external.std).all()
    nodes.close()


def test_what_holds_the_arm_is_published(model_file, nodes, tmp_path):
    """Gravity and the static effects of the model; those that depend on time are named."""
    effects = (SPRING,
               applied('torque_offset', 'a', b=0.7),
               applied('coulomb_friction', 'a', {'width': 0.005}, F_c=FRICTION))
    model, path, q = load_model(model_file), tmp_path / 'model.json', np.array([0.3, 0.2])
    # Outside the trained range a spring is not extrapolated.
    outside, high = np.array([0.3, 0.9]), model.coverage.q_max[1]
    assert 0.2 < high < 0.6
    for extra, level in (((), OK), ((applied(
            'encoder_offset', 'a', {'run': 0.0, 'time': 0.0, 'clock': 0.0}, delta=0.1),), WARN)):
        save_model(path, replace(model, applied=Applied((*effects, *extra))))
        node = nodes.make(model_file=str(path), ramp_time=0.0, max_torque_rate=(), max_age=0.0,
                          max_torque=(50.0,))
        np.testing.assert_allclose(send(node, 1.0, q, 0 * q + 0.1, 0 * q),
                                   model.predict_one(q) + [0.7, 2.0 * 0.1])
        np.testing.assert_allclose(send(node, 1.1, outside),
                                   model.predict_one(outside) + [0.7, 2.0 * (high - 0.1)])
        status = {s.name: s for s in node.statuses(1.0)}['feed-forward']
        assert status.level == level
        assert set(status.values['static effects'].split(', ')) == {
            'joint_spring:b', 'torque_offset:a'}
        assert all(effect.target in status.message for effect in extra)
    nodes.close()
