"""External torque and position offset of the node, over DDS."""

from bench.shared.ros_harness import part, published, running, until_last
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.evaluation.external_torque import external_torque
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.models.sparse.dictionary import Expansion
import numpy as np
from sensor_msgs.msg import JointState

PARAMETERS = {'ramp_time': 0.0, 'max_torque_rate': '[]', 'extrapolation_margin': 10.0,
              'stale_after': 10.0, 'unlimited_torque': True, 'servo_stiffness': '[160.0, 60.0]'}


def test_external_torque_and_position_offset_of_a_pushed_arm(tmp_path):
    """A pendulum with a motor moves and is pushed by 2 N·m after a second."""
    energy = Expansion(np.array([2, 6]), np.array([-3.0, -8.0]))  # cos q_b, cos q_a
    model = GravityModel.from_energy(
        ('a', 'b'), 'potential', energy, np.full(2, 0.1),
        Coverage(np.full(2, -1.0), np.full(2, 1.0), 100), {},
        covariance=1e-6 * np.eye(2))
    save_model(tmp_path / 'm.json', model)
    t = np.arange(0.0, 2.0, 0.01)
    q = np.column_stack([-0.5 + 0.1 * t, 0.4 + 0.1 * t])
    tau = model.predict(q) + 1e-3 * np.random.default_rng(0).normal(size=q.shape)
    tau[t >= 1.0, 1] -= 2.0
    samples = JointSamples.single_run(model.joints, t + 10.0, q, np.full_like(q, 0.1), tau)
    parameters = {**PARAMETERS, 'model_file': tmp_path / 'm.json'}
    received = {name: [] for name in ('external_torque', 'external_torque_std',
                                      'external_torque_significant', 'position_offset')}
    with running(parameters, wait=False) as (node, probe):
        for name, into in received.items():
            probe._outputs.append(probe.create_subscription(
                JointState, f'/gravity_comp/{name}', into.append, 1000))
        probe.until_node(node)
        start = iter(range(1000))

        def answered():
            # The arm stands at its first pose until the node has discovered all subscribers.
            probe.send(samples.names, 1.0 + 0.01 * next(start), q[0], 0 * q[0], tau[0])
            return all(received.values())

        probe.until(answered, 60, 'the first external torque')
        # Fewer at once than the node's queue has places.
        for first in range(0, len(samples), 50):
            probe.stream(part(samples, first, first + 50), period=0.01)
            until_last(probe, part(samples, first, first + 50), received['position_offset'])
    rows, offsets = published(samples, [
        JointState(header=m.header, name=m.name, effort=m.position)
        for m in received['position_offset']])
    np.testing.assert_allclose(offsets, model.predict(q[rows]) / [160.0, 60.0], atol=1e-9)
    for name, before, after in (('external_torque', 0.0, -2.0),
                                ('external_torque_significant', 0.0, -2.0),
                                ('external_torque_std', 0.1, None)):
        rows, values = published(samples, received[name])
        early, late = values[t[rows] < 0.9, 1], values[t[rows] > 1.2, 1]
        assert len(early) and len(late)
        np.testing.assert_allclose(early, before, atol=1e-2)
        if after is not None:
            np.testing.assert_allclose(late, after, atol=1e-2)
        else:
            # The push is a scatter between windows, of which a second forgets most.
            assert 0.1 < late[-1] < late[0] < 0.3
    rows, values = published(samples, received['external_torque'])
    # Windows of four messages of which the node has dropped none.
    whole = [k for k, row in enumerate(rows) if {row - 1, row - 2, row - 3} <= set(rows)]
    assert len(whole) > 100
    offline = external_torque(model, samples).torque
    np.testing.assert_allclose(values[whole], offline[rows][whole], atol=1e-6)
