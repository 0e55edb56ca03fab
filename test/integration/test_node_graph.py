"""Status of the ROS graph, and log of the node, over DDS."""

from bench.shared.ros_harness import NodeProcess, ROOT, running, set_parameter
from geometry_msgs.msg import InertiaStamped
from gravity_comp_ros.recordings.bag import read_bag
import numpy as np
import pytest
from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

LATCHED = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BAGS = ROOT / 'bags'
OK, WARN, ERROR = b'\x00', b'\x01', b'\x02'


class NodeLog:
    """The log of the node."""

    def __init__(self, probe):
        self.lines, self.probe = [], probe
        probe.create_subscription(Log, '/rosout', lambda m: self.lines.append((m.level, m.msg)),
                                  LATCHED)

    def until(self, *message, level=Log.INFO):
        """Wait for a line of this level with all these words."""
        self.probe.until(lambda: any(level == at and all(word in text for word in message)
                                     for at, text in self.lines),
                         60, f'a line of the log with {message}, got {self.lines}')


def test_the_log_has_events_and_reasons(iiwa_model_file, tmp_path):
    folder = tmp_path / 'models'
    folder.mkdir()
    path = folder / 'model.json'
    path.write_bytes(iiwa_model_file.read_bytes())
    loaded = read_bag(BAGS / 'eq17_2kg.mcap').samples
    options = {'model_file': path, 'auto_save': True, 'ramp_time': 0.0, 'settle_time': 0.0,
               'diagnostics_rate': 20.0, 'max_torqe': '[9.0]', 'formulation': 'chain',
               'stale_after': 3.0}
    with running(options) as (_, probe):
        log, payloads = NodeLog(probe), []
        probe.create_subscription(InertiaStamped, '/gravity_comp/payload', payloads.append,
                                  LATCHED)
        log.until('parameter max_torqe', 'did you mean max_torque?', level=Log.WARN)
        log.until('arm of 7 joints', 'iiwa_joint_7', 'chain model', 'formulation of fits: chain',
                  'torque limits: none set')
        latch = probe.create_publisher(String, 'robot_description', LATCHED)
        latch.publish(String(data=(BAGS / 'iiwa7.urdf').read_text()))
        log.until('robot description', 'axes used', 'effort limits 176')
        path.unlink()
        folder.rmdir()
        assert 'epoch 0 closed' in probe.report('learning').message
        probe.call('payload_changed')
        assert 'epoch 1 open' in probe.report('learning').message
        probe.stream(loaded.select(np.arange(60)))
        log.until('new model in use', 'held-out RMSE', 'N·m')
        probe.until(lambda: any(p.inertia.m > 1.0 for p in payloads), 60, 'the payload')
        log.until('nothing was changed', level=Log.WARN)
        log.until('input: input is stale', level=Log.WARN)
    # The model of the file has none.
    assert np.isnan(payloads[0].inertia.m)
    payload = payloads[-1]
    assert payload.header.frame_id == 'iiwa_link_7'
    assert payload.inertia.m == pytest.approx(2.0, abs=0.2)
    assert payload.inertia.com.z == pytest.approx(0.1, abs=0.05)


def test_a_second_node_a_second_driver_and_a_gripper_are_detected(iiwa_model_file):
    samples = read_bag(BAGS / 'eq17_later.mcap').samples
    options = {'diagnostics_rate': 10.0, 'max_torque': '[176.0]', 'stale_after': 10.0,
               'auto_fit': False}
    with running(options) as (_, probe):
        # A gripper publishes first, and continues between the messages of the arm.
        for k in range(40):
            t = 10.0 + samples.t[k]
            probe.send(['finger'], t - 0.05, [0.01], [0.0], [1.0])
            probe.spin(0.005)
            probe.send(samples.names, t, samples.q[k], samples.qd[k], samples.tau[k])
            probe.spin(0.005)
        probe.until(lambda: 'joint iiwa_joint_1' in probe.status, 60, 'the arm')
        assert 'dropped' not in probe.report('input').message
        result = set_parameter(probe, 'max_torque', [1.0, 2.0])
        assert not result.successful and 'iiwa_joint_1, iiwa_joint_2' in result.reason
        twin = NodeProcess(probe.context.get_domain_id(), {'model_file': iiwa_model_file})
        try:
            probe.until(lambda: probe.status['graph'].level == ERROR, 60, 'the twin noticed')
            assert '2 nodes are named /gravity_comp' in probe.status['graph'].message
        finally:
            twin.end()
        probe.until(lambda: probe.status['graph'].level == OK, 60, 'the twin gone')
        other = probe.create_publisher(JointState, 'joint_states', 10)
        k = 40

        def two_drivers():
            nonlocal k
            k += 1
            probe.send(samples.names, 10.0 + samples.t[k], samples.q[k], samples.qd[k],
                       samples.tau[k])
            late = JointState(name=list(samples.names), position=samples.q[k].tolist())
            late.header.stamp.sec = int(samples.t[k] + 5.0)
            other.publish(late)
            probe.spin(0.02)
            return probe.status['graph'].level == WARN

        probe.until(two_drivers, 60, 'the second driver noticed')
        assert '2 publishers on /joint_states' in probe.status['graph'].message


def test_two_arms_in_two_namespaces_by_the_yaml_of_the_package(iiwa_model_file):
    files = ('--params-file', str(ROOT / 'config' / 'gravity_comp.yaml'))
    samples = read_bag(BAGS / 'eq17_later.mcap').samples
    with running({}, ('-r', '__ns:=/left', *files), wait=False) as (_, probe):
        seen = probe.create_publisher(JointState, '/left/joint_states', 10)
        statuses = probe.status
        probe.until(lambda: any('left/gravity_comp' in name for name in statuses)
                    and seen.get_subscription_count() == 1, 60, 'the left arm')
        assert probe.publisher.get_subscription_count() == 0
        assert {name.split(':')[0] for name in statuses} == {'left/gravity_comp'}
        message = JointState(name=list(samples.names), position=samples.q[0].tolist())
        seen.publish(message)
        probe.until(lambda: 'left/gravity_comp: feed-forward' in statuses, 60)
        values = {pair.key: pair.value
                  for pair in statuses['left/gravity_comp: feed-forward'].values}
        assert values['torque limits'] == 'set'
