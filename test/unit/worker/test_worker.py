"""Real worker processes: results, failures, and their end with the parent process."""

from contextlib import contextmanager
import os
from pathlib import Path
import signal
import subprocess
import sys
from threading import get_ident
import time

from bench.shared.worker_tasks import is_running, LastJob
from gravity_comp_ros.worker.worker_process import (
    command, Done, Failed, Progress, Worker, WorkerProcess)
import pytest

TIMEOUT = 30.0


@contextmanager
def running(task='bench.shared.worker_tasks:doing'):
    worker = WorkerProcess(command(task, 0))
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


def test_progress_and_result_are_sent_in_order():
    with running() as worker:
        worker.send(lambda: ('sleep', 0.01))
        progress, done = wait_for(worker, 2)
        assert progress == Progress('sleeping', 0.5)
        assert isinstance(done, Done) and done.answer == 'sleep'
    assert worker.pid is None and worker.messages() == []


@pytest.mark.parametrize('job, reason', [
    (('refuse', 'no joint moves'), 'no joint moves'),
    (('break', 'q'), "internal error, please report it: KeyError: 'q'")])
def test_a_failed_job_does_not_end_the_process(job, reason):
    with running() as worker:
        worker.send(lambda: job)
        assert wait_for(worker, 1) == [Failed(reason)]
        pid = worker.pid
        worker.send(lambda: ('done', None))
        assert wait_for(worker, 1)[0].answer == 'done' and worker.pid == pid


def test_a_pipe_that_closes_while_a_job_is_sent_is_a_loss_and_no_fault_of_the_job():
    with running('bench.shared.worker_tasks:closing') as worker:
        worker.send(lambda: ('done', None))
        wait_for(worker, 1)
        worker.send(lambda: LastJob(worker))
        # Its exit status is known only if it ends soon.
        (lost,) = wait_for(worker, 1)
        assert lost.is_lost


def test_sending_a_large_job_does_not_block():
    with running() as worker:
        # The process is still importing, and the pipe buffers about 64 KiB.
        worker.send(lambda: ('length', bytes(20_000_000)))
        assert wait_for(worker, 1)[0].answer == 20_000_000


def test_a_process_that_exits_at_once_is_lost_with_its_exit_code():
    with running('bench.shared.worker_tasks:failing') as worker:
        assert wait_for(worker, 1) == [Failed('the worker process died (exit code 4)', True)]
        assert worker.pid is None


def test_the_process_ends_with_its_parent_during_a_job():
    program = ('from gravity_comp_ros.worker.worker_process import command, WorkerProcess\n'
               'import os, time\n'
               'worker = WorkerProcess(command("bench.shared.worker_tasks:doing", 0))\n'
               'worker.send(lambda: ("sleep", 600.0))\n'
               'received = []\n'
               'while not received:\n'
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


PARTIAL = """
import os, struct, sys, time
pipe = int(sys.argv[1])
os.write(pipe, struct.pack('!i', 50_000_000) + bytes(100))
print('sent', flush=True)
time.sleep(600.0)
"""


def test_a_process_that_stops_within_a_message_blocks_no_call():
    """It has announced 50 MB and sends 100 bytes."""
    worker = WorkerProcess((sys.executable, '-c', PARTIAL))
    pid = read_from(worker)
    calls = [lambda: worker.messages(), lambda: worker.send(lambda: ('done', None)), worker.end,
             lambda: worker.messages()]
    longest = 0.0
    for call in calls:
        began = time.monotonic()
        call()
        longest = max(longest, time.monotonic() - began)
    # A blocking read would last until the process is killed, 600 s later.
    assert longest < TIMEOUT and worker.pid is None
    end = time.monotonic() + TIMEOUT
    while is_running(pid):
        assert time.monotonic() < end
        time.sleep(0.005)


def read_from(worker):
    """Wait until the process has sent its part; return its id."""
    end = time.monotonic() + TIMEOUT
    while time.monotonic() < end:
        if worker.pid is not None:
            wchan = Path(f'/proc/{worker.pid}/wchan').read_text(errors='replace')
            if 'nanosleep' in wchan or wchan == '0':
                break
        time.sleep(0.005)
    return worker.pid


def test_a_job_is_prepared_in_another_thread():
    with running() as worker:
        threads = []

        def make():
            threads.append(get_ident())
            return 'done', 7

        worker.send(make)
        assert wait_for(worker, 1)[0].answer == 'done' and threads != [get_ident()]
        worker.send(lambda: 7 / 0)
        assert 'ZeroDivisionError' in wait_for(worker, 1)[0].reason


def test_unreadable_messages_end_in_a_lost_process():
    code = "import os, struct, sys; os.write(int(sys.argv[1]), struct.pack('!i', 4) + b'nope')"
    worker = WorkerProcess((sys.executable, '-c', code))
    assert wait_for(worker, 1)[0].is_lost


@pytest.mark.parametrize('task, reason', [
    ('bench.shared.worker_tasks:failing', 'exit code 4'), ('no.such:program', 'exit code 1')])
def test_each_job_has_one_answer_and_a_lost_process_is_replaced(task, reason):
    worker, answers = Worker('bench.shared.worker_tasks:doing', 0), []

    def poll(count):
        end = time.monotonic() + TIMEOUT
        while len(answers) < count:
            assert time.monotonic() < end
            answers.extend((job, message) for job, message in worker.poll()
                           if not isinstance(message, Progress))
            time.sleep(0.002)

    try:
        for number in (1, 2):
            worker.start(number, lambda: ('done', None))
        assert worker.jobs == [1, 2]
        poll(2)
        assert [job for job, _ in answers] == [1, 2] and worker.job is None
        pid = worker.pid
        os.kill(pid, signal.SIGKILL)
        worker.start(3, lambda: ('done', None))
        worker.start(4, lambda: ('done', None))
        poll(4)
        assert 'signal 9' in answers[2][1].reason and isinstance(answers[3][1], Done)
        assert worker.pid != pid
        worker.rest()
        worker._command = command(task, 0)
        worker.start(5)
        poll(5)
        assert reason in answers[4][1].reason and worker.pid is None and worker.job is None
    finally:
        worker.rest()
