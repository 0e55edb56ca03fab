"""First fits, diagnosis and priority of the fit process; executor of the node in this process."""

from dataclasses import replace
from pathlib import Path
import re
import subprocess
import sys
import time
from types import SimpleNamespace

from bench.shared.dds_domain import private_domain
from bench.shared.rough_links import two_links
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.node import node as node_module
from gravity_comp_ros.node.checks import DIAGNOSIS, FIT, Job
from gravity_comp_ros.node.epoch import Rows
from gravity_comp_ros.node.jobs import run_diagnosis, run_fit
from gravity_comp_ros.node.node import GravityCompNode
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.node.run import InputFirstExecutor
import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.task import Future
from std_srvs.srv import Trigger

ROOT = Path(__file__).resolve().parents[3]
POTENTIAL = Parameters(formulation='potential')


@pytest.mark.parametrize(('gains', 'kind'), [
    ([-1.0, -1.0], 'effort_sign'), ([1.0, 4.0], 'effort_gain')])
def test_a_first_model_is_not_learned_from_what_fit_refuses(gains, kind):
    rough = two_links(1)
    samples = replace(rough, tau=rough.tau * gains).select(np.arange(0, 1200, 4))
    rows = Rows(samples, np.arange(300) % 20 >= 15)
    result = run_fit(Job(FIT, rows, settings=POTENTIAL))
    assert not result.accepted and kind in result.fault
    if kind == 'effort_sign':
        assert run_fit(Job(
            FIT, rows, settings=replace(POTENTIAL, accept=(kind,)))).checks[0].passed


PRIORITY = """
import os, sys, time
from gravity_comp_ros.worker.worker_process import command, Done, Worker
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
except PermissionError:
    sys.exit(77)
worker, messages = Worker(command('bench.shared.worker_tasks:doing', 10)), []
worker.start(('done', None))
end = time.monotonic() + 60.0
while not messages and time.monotonic() < end:
    messages = [type(message) is Done for _, message in worker.poll()]
    time.sleep(0.01)
print(messages, os.sched_getscheduler(0) == os.SCHED_FIFO,
      os.sched_getscheduler(worker.pid) == os.SCHED_OTHER, os.getpriority(0, worker.pid))
worker.rest()
"""


def test_it_does_not_inherit_real_time_priority():
    done = subprocess.run([sys.executable, '-c', PRIORITY], cwd=ROOT, capture_output=True,
                          text=True, timeout=120)
    if done.returncode == 77:
        pytest.skip('real-time priority is for the privileged')
    assert done.stdout.split() == ['[True]', 'True', 'True', '10'], done


def test_a_diagnosis_names_the_motion_that_resolves_open_findings():
    # On a joint that moves in one direction only, friction and offset are collinear.
    samples = two_links(0, one_way=True)
    rows = Rows(samples, np.zeros(len(samples), dtype=bool))
    result = run_diagnosis(Job(DIAGNOSIS, rows, fit(samples, FitOptions('potential')).model))
    assert 'torque_offset:shoulder (ambiguous)' in result
    match = re.search(r'to resolve open findings, move for (\d+) s: (.*?) \(`gravity_comp plan`',
                      result)
    assert match and 2 <= int(match[1]) <= 20, result
    assert re.search(r'\d to [\d.]+ s: shoulder back and forth', match[2])
    # Without a model no motion is planned.
    assert 'to resolve' not in run_diagnosis(Job(DIAGNOSIS, rows))


LONG = 60.0


@pytest.fixture
def executor():
    with private_domain() as domain:
        context = Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        one = InputFirstExecutor(lambda: None, lambda messages: None, lambda problem: None,
                                 context)
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


def test_an_error_in_a_callback_is_reported_and_ends_no_other(executor):
    problems, answered = [], []

    def callback():
        raise RuntimeError('a bug')

    executor._failed = problems.append
    executor.create_task(callback)
    executor.create_task(answered.append, True)
    executor._handle_others(time.monotonic() + LONG)
    assert answered and [str(problem) for problem in problems] == ['a bug']


def test_the_torque_falls_after_an_error_although_no_report_can_be_made(monkeypatch):
    """The error may be one of the clock, of the log or of a publisher."""
    def fails(*_):
        raise OSError('no space left')

    sent, torques = [], iter([3.0, 2.0, 1.0, None])

    def torque(stamp, tau):
        sent.append(tau)
        if tau == 2.0:
            fails()

    feed = SimpleNamespace(fail=lambda: sent.append('failed'), watch=lambda now: next(torques))
    arm = SimpleNamespace(feed=feed)
    stamp = SimpleNamespace(to_msg=lambda: None)
    node = SimpleNamespace(
        _core=SimpleNamespace(arm=arm), _active=True, now=lambda: 0.0, get_logger=fails,
        _outputs=SimpleNamespace(torque=torque, diagnostics=fails),
        get_clock=lambda: SimpleNamespace(now=lambda: stamp))
    node.report = lambda problem: GravityCompNode.report(node, problem)
    monkeypatch.setattr(node_module.rclpy, 'ok', lambda: True)
    GravityCompNode.end_torque(node, RuntimeError('a bug'))
    assert sent == ['failed', 3.0, 2.0, 1.0]


def test_an_error_while_it_is_configured_is_reported_and_leaves_nothing_behind():
    def fails():
        raise OSError('no space left')

    closed, errors = [], []
    node = SimpleNamespace(_configure=fails, close=lambda: closed.append(True),
                           get_logger=lambda: SimpleNamespace(error=errors.append))
    assert GravityCompNode.on_configure(node, None) == TransitionCallbackReturn.FAILURE
    assert closed and 'no space left' in errors[0]
