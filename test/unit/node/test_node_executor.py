"""The executor of the node in this process; `test/integration` runs it over DDS."""

import time
from types import SimpleNamespace

from bench.shared.dds_domain import private_domain
from gravity_comp_ros.node import node as node_module
from gravity_comp_ros.node.node import GravityCompNode
from gravity_comp_ros.node.run import InputFirstExecutor
import pytest
import rclpy
from rclpy.context import Context
from rclpy.task import Future
from std_srvs.srv import Trigger

LONG = 60.0


@pytest.fixture
def executor():
    with private_domain() as domain:
        context = Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        one = InputFirstExecutor(lambda: None, lambda messages: None, context)
        yield one
        one.shutdown()
        context.shutdown()


def test_a_call_that_waits_for_a_fit_does_not_occupy_the_thread(executor):
    fit, steps = Future(executor=executor), []

    async def call():
        steps.append('started')
        await fit
        steps.append('answered')

    executor.create_task(call)
    began = time.monotonic()
    executor._handle_others(began + LONG)
    assert time.monotonic() - began < LONG and steps == ['started']
    fit.set_result(True)
    executor._handle_others(time.monotonic() + LONG)
    assert steps == ['started', 'answered']


def test_a_request_is_seen_and_answered_without_the_search_of_rclpy(executor):
    node = rclpy.create_node('one', context=executor.context)
    executor.add_node(node)

    def answer(request, response):
        response.success = True
        return response

    node.create_service(Trigger, '~/call', answer)
    assert executor._handle_input(0.0) == (False, False)
    client = node.create_client(Trigger, '/one/call')
    assert client.wait_for_service(LONG)
    answered, end = client.call_async(Trigger.Request()), time.monotonic() + LONG
    while not executor._handle_input(0.1)[1]:
        assert time.monotonic() < end
    while not answered.done():
        assert time.monotonic() < end
        executor._handle_others(end)
    assert answered.result().success
    node.destroy_node()


def test_an_error_in_a_callback_is_raised(executor):
    def callback():
        raise RuntimeError('a bug')

    executor.create_task(callback)
    with pytest.raises(RuntimeError, match='a bug'):
        executor._handle_others(time.monotonic() + LONG)


def test_the_torque_falls_after_an_error_although_no_report_can_be_made(monkeypatch):
    """The error may be one of the clock, of the log or of a publisher."""
    def fails(*_):
        raise OSError('no space left')

    sent, torques = [], iter([3.0, 2.0, 1.0, None])

    def torque(stamp, tau):
        sent.append(tau)
        if tau == 2.0:
            fails()

    feed = SimpleNamespace(fail=lambda: sent.append('failed'))
    arm = SimpleNamespace(feed=feed, watchdog=lambda now: next(torques))
    stamp = SimpleNamespace(to_msg=lambda: None)
    node = SimpleNamespace(
        _core=SimpleNamespace(arm=arm), _active=True, now=lambda: 0.0, get_logger=fails,
        _outputs=SimpleNamespace(torque=torque, diagnostics=fails),
        get_clock=lambda: SimpleNamespace(now=lambda: stamp))
    monkeypatch.setattr(node_module.rclpy, 'ok', lambda: True)
    GravityCompNode.end_torque(node, RuntimeError('a bug'))
    assert sent == ['failed', 3.0, 2.0, 1.0]
