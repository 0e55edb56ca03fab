"""Real worker processes: results, failures, and their end with the parent process."""

from contextlib import contextmanager
import os
import subprocess
import sys
import time

from gravity_comp_ros.worker.messages import Done, Failed, Lost, Progress, Ready
from gravity_comp_ros.worker.worker_process import command, WorkerProcess
import pytest
from running_process import is_running

TIMEOUT = 30.0


@contextmanager
def running(task='worker_tasks:doing'):
    worker = WorkerProcess(command(task, 0))
    worker.start()
    try:
        yield worker
    finally:
        worker.end()


def wait_for(worker, count):
    """Wait for this number of messages and return them."""
    received, end = [], time.monotonic() + TIMEOUT
    while len(received) < count:
        assert time.monotonic() < end, received
        received += worker.messages()
        time.sleep(0.002)
    return received


def test_ready_progress_and_result_are_sent_in_order():
    with running() as worker:
        worker.send(('sleep', 0.01))
        ready, progress, done = wait_for(worker, 3)
        assert (ready, progress) == (Ready(), Progress('sleeping', 0.5))
        assert isinstance(done, Done) and done.answer == 'sleep'
    assert worker.pid is None and worker.messages() == []


@pytest.mark.parametrize('job, reason', [
    (('refuse', 'no joint moves'), 'no joint moves'),
    (('break', 'q'), "internal error, please report it: KeyError: 'q'")])
def test_a_failed_job_does_not_end_the_process(job, reason):
    with running() as worker:
        wait_for(worker, 1)
        pid = worker.pid
        worker.send(job)
        assert wait_for(worker, 1) == [Failed(reason)]
        worker.send(('done', None))
        assert wait_for(worker, 1)[0].answer == 'done' and worker.pid == pid


def test_sending_a_large_job_does_not_block():
    with running() as worker:
        # The process is still importing, and the pipe buffers about 64 KiB.
        worker.send(('length', bytes(20_000_000)))
        ready, done = wait_for(worker, 2)
        assert ready == Ready() and done.answer == 20_000_000


def test_a_process_that_exits_at_once_is_lost_with_its_exit_code():
    with running('worker_tasks:failing') as worker:
        assert wait_for(worker, 1) == [Lost('exit code 4')]
        assert worker.pid is None


def test_the_process_ends_with_its_parent_during_a_job():
    program = ('from gravity_comp_ros.worker.worker_process import command, WorkerProcess\n'
               'import os, time\n'
               'worker = WorkerProcess(command("worker_tasks:doing", 0))\n'
               'worker.start()\n'
               'worker.send(("sleep", 600.0))\n'
               'received = []\n'
               'while len(received) < 2:\n'
               '    received += worker.messages()\n'
               '    time.sleep(0.01)\n'
               'print(worker.pid, flush=True)\n'
               'os._exit(0)')
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True,
                          timeout=TIMEOUT, check=True,
                          env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)})
    end = time.monotonic() + TIMEOUT
    while is_running(int(done.stdout)):
        assert time.monotonic() < end, 'the worker outlives its parent'
        time.sleep(0.01)
