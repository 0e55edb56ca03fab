"""A worker process, a real one: its answers, faults, and its end with the one that started it."""

from contextlib import contextmanager
import os
import subprocess
import sys
import time

from gravity_comp_ros.worker.messages import Done, Failed, Lost, Progress, Ready
from gravity_comp_ros.worker.worker_process import command, WorkerProcess
from living import lives
import pytest

PATIENCE = 30.0


@contextmanager
def running(task='worker_tasks:doing'):
    worker = WorkerProcess(command(task, 0))
    worker.start()
    try:
        yield worker
    finally:
        worker.end()


def said(worker, count):
    """Wait for so many messages."""
    found, end = [], time.monotonic() + PATIENCE
    while len(found) < count:
        assert time.monotonic() < end, found
        found += worker.messages()
        time.sleep(0.002)
    return found


def test_it_is_ready_and_tells_how_far_it_is_before_it_answers():
    with running() as worker:
        worker.send(('sleep', 0.01))
        ready, progress, done = said(worker, 3)
        assert (ready, progress) == (Ready(), Progress('sleeping', 0.5))
        assert isinstance(done, Done) and done.answer == 'sleep'
    assert worker.pid is None and worker.messages() == []


@pytest.mark.parametrize('job, reason', [
    (('refuse', 'no joint moves'), 'no joint moves'),
    (('break', 'q'), "internal error, please report it: KeyError: 'q'")])
def test_a_fault_of_a_job_costs_no_process(job, reason):
    with running() as worker:
        said(worker, 1)
        pid = worker.pid
        worker.send(job)
        assert said(worker, 1) == [Failed(reason)]
        worker.send(('done', None))
        assert said(worker, 1)[0].answer == 'done' and worker.pid == pid


def test_a_large_job_does_not_hold_up_who_sends_it():
    with running() as worker:
        # It is still importing, and the pipe takes some 64 KiB.
        worker.send(('length', bytes(20_000_000)))
        ready, done = said(worker, 2)
        assert ready == Ready() and done.answer == 20_000_000


def test_a_task_that_fails_at_once_is_lost_with_its_exit_code():
    with running('worker_tasks:failing') as worker:
        assert said(worker, 1) == [Lost('exit code 4')]
        assert worker.pid is None


def test_it_ends_with_its_parent_in_the_middle_of_a_job():
    program = ('from gravity_comp_ros.worker.worker_process import command, WorkerProcess\n'
               'import os, time\n'
               'worker = WorkerProcess(command("worker_tasks:doing", 0))\n'
               'worker.start()\n'
               'worker.send(("sleep", 600.0))\n'
               'found = []\n'
               'while len(found) < 2:\n'
               '    found += worker.messages()\n'
               '    time.sleep(0.01)\n'
               'print(worker.pid, flush=True)\n'
               'os._exit(0)')
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True,
                          timeout=PATIENCE, check=True,
                          env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)})
    end = time.monotonic() + PATIENCE
    while lives(int(done.stdout)):
        assert time.monotonic() < end, 'the worker outlives its parent'
        time.sleep(0.01)
