"""The executor of the node in this process; `test/integration` runs it over DDS."""

import time

from bench.shared.dds_domain import private_domain
from gravity_comp_ros.node.priority_executor import InputFirstExecutor
import pytest
import rclpy
from rclpy.context import Context
from rclpy.task import Future

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


def test_an_error_in_a_callback_is_raised(executor):
    def callback():
        raise RuntimeError('a bug')

    executor.create_task(callback)
    with pytest.raises(RuntimeError, match='a bug'):
        executor._handle_others(time.monotonic() + LONG)
