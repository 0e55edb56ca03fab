"""A relearned payload reaches a compiled controller over DDS, without compiling."""

from pathlib import Path
import time

from bench.shared.compiled_model import compiled
from bench.shared.dds_domain import private_domain
from builtin_interfaces.msg import Time
import gravity_comp_ros as gc
from gravity_comp_ros.export.c_source import parameters_of
from gravity_comp_ros.export.payload_lines import Payload
from gravity_comp_ros.models.applied_effects import Quantity
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.node.outputs import LATCHED, model_message, payload_message
import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Float64MultiArray

BAGS = Path(__file__).resolve().parents[2] / 'bags'


@pytest.fixture
def ros():
    """Yield an executor with a sender and a receiver in a domain of their own."""
    with private_domain() as domain:
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=domain)
        nodes = [rclpy.create_node(name, context=context) for name in ('sender', 'receiver')]
        executor = SingleThreadedExecutor(context=context)
        for node in nodes:
            executor.add_node(node)
        yield executor, *nodes
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown(context=context)


def test_a_payload_is_swapped_into_a_compiled_library(ros, iiwa_model_file, tmp_path):
    executor, sender, receiver = ros
    old = load_model(iiwa_model_file)
    new = gc.update(gc.Model(old), gc.read(BAGS / 'eq17_2kg.mcap')).gravity
    library = compiled(old, tmp_path)
    q = np.random.default_rng(0).uniform(old.coverage.q_min, old.coverage.q_max, (300, 7))
    assert np.abs(new.predict(q) - old.predict(q)).max() > 5.0
    np.testing.assert_allclose(library.gravity(q), old.predict(q), rtol=0, atol=1e-9)
    results = []

    def received(message):
        layout = int(message.layout.dim[0].label, 16)
        assert message.layout.dim[0].size == len(message.data) == len(message.layout.dim) - 1
        results.append(library.set_parameters(message.data, layout))

    publisher = sender.create_publisher(Float64MultiArray, '/arm/model', LATCHED)
    publisher.publish(model_message(parameters_of(new)))
    # Latched: a controller that starts later receives the model in use.
    receiver.create_subscription(Float64MultiArray, '/arm/model', received, LATCHED)
    end = time.monotonic() + 20.0
    while not results and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    assert results == [0]
    np.testing.assert_allclose(library.gravity(q), new.predict(q), rtol=0, atol=1e-9)
    np.testing.assert_allclose(library.distance(q), new.coverage.distance(q).max(axis=1))


def test_a_payload_as_a_message():
    payload = Payload('tool0', Quantity(2.0, 'kg', (1.9, 2.1)), {
        axis: Quantity(value, 'm', (value, value)) for axis, value in zip('xyz', (0.1, 0.2, 0.3))})
    message = payload_message(payload, Time(sec=3))
    assert message.header.frame_id == 'tool0' and message.header.stamp.sec == 3
    assert np.isnan(payload_message(None, Time()).inertia.m)
    assert message.inertia.m == 2.0 and message.inertia.ixx == 0.0
    assert (message.inertia.com.x, message.inertia.com.y, message.inertia.com.z) == (0.1, 0.2, 0.3)


def test_a_message_names_every_number(iiwa_model_file):
    parameters = parameters_of(load_model(iiwa_model_file))
    message = model_message(parameters)
    assert [dim.label for dim in message.layout.dim[1:]] == parameters.labels
    assert message.layout.dim[1].label == 'iiwa_joint_1 q_min rad'
    np.testing.assert_array_equal(message.data, parameters.values)
