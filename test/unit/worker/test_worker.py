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
from gravity_comp_ros.worker.worker_process import command, Done, Failed, Progress, Worker
import pytest

TIMEOUT = 30.0


@contextmanager
def running(*line):
    """Return a worker of a command line, by default one of simple tasks."""
    worker = Worker(line or command('bench.shared.worker_tasks:doing', 0))
    try:
        yield worker
    finally:
        worker.rest()


def wait_for(worker, count=1):
    """Wait for this number of messages and return them."""
    received, end = [], time.monotonic() + TIMEOUT
    while len(received) < count:
        assert time.monotonic() < end, received
        received += [message for _, message in worker.poll()]
        time.sleep(0.002)
    return received


def test_progress_and_result_are_sent_in_order():
    with running() as worker:
        worker.start(('sleep', 0.01))
        progress, done = wait_for(worker, 2)
        assert progress == Progress('sleeping', 0.5)
        assert isinstance(done, Done) and done.answer == 'sleep'
    assert worker.pid is None and worker.poll() == []


@pytest.mark.parametrize('job, reason', [
    (('refuse', 'no joint moves'), 'no joint moves'),
    (('break', 'q'), "internal error, please report it: KeyError: 'q'")])
def test_a_failed_job_does_not_end_the_process(job, reason):
    with running() as worker:
        worker.start(job)
        assert wait_for(worker) == [Failed(reason)]
        pid = worker.pid
        worker.start(('done', None))
        assert wait_for(worker)[0].answer == 'done' and worker.pid == pid


def test_a_pipe_that_closes_while_a_job_is_sent_is_a_loss_and_no_fault_of_the_job():
    with running(*command('bench.shared.worker_tasks:closing', 0)) as worker:
        worker.start(('done', None))
        wait_for(worker)
        worker.start(LastJob(worker))
        # Its exit status is known only if it ends soon.
        (lost,) = wait_for(worker)
        assert lost.is_lost


def test_sending_a_large_job_does_not_block():
    with running() as worker:
        # The process is still importing, and the pipe buffers about 64 KiB.
        worker.start(('length', bytes(20_000_000)))
        assert wait_for(worker)[0].answer == 20_000_000


def test_the_process_ends_with_its_parent_during_a_job():
    program = ('from gravity_comp_ros.worker.worker_process import command, Worker\n'
               'import os, time\n'
               'worker = Worker(command("bench.shared.worker_tasks:doing", 0))\n'
               'worker.start(("sleep", 600.0))\n'
               'while not worker.poll():\n'
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
    with running(sys.executable, '-c', PARTIAL) as worker:
        worker.start(('done', None))
        pid = read_from(worker)
        longest = 0.0
        for call in (worker.poll, lambda: worker.start(('done', None)), worker.rest, worker.poll):
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

        worker.start('job', make)
        assert wait_for(worker)[0].answer == 'done' and threads != [get_ident()]
        worker.start('job', lambda: 7 / 0)
        assert 'ZeroDivisionError' in wait_for(worker)[0].reason


UNREADABLE = "import os, struct, sys; os.write(int(sys.argv[1]), struct.pack('!i', 4) + b'nope')"


@pytest.mark.parametrize('line, reason', [
    (command('bench.shared.worker_tasks:failing', 0), 'exit code 4'),
    (('/no/such/program',), 'cannot be started'), ((sys.executable, '-c', UNREADABLE), 'died')])
def test_a_process_that_ends_is_a_loss_with_its_reason(line, reason):
    with running(*line) as worker:
        worker.start(('done', None))
        (lost,) = wait_for(worker)
        assert lost.is_lost and reason in lost.reason and worker.pid is None


def test_each_job_has_one_answer_and_a_lost_process_is_replaced():
    with running() as worker:
        worker.prepare()
        assert worker.poll() == [] and worker.job is None
        for number in (1, 2):
            worker.start(number, lambda: ('done', None))
        assert worker.jobs == [1, 2]
        assert all(isinstance(message, Done) for message in wait_for(worker, 2))
        pid = worker.pid
        assert worker.job is None
        os.kill(pid, signal.SIGKILL)
        for number in (3, 4):
            worker.start(number, lambda: ('done', None))
        lost, done = wait_for(worker, 2)
        assert 'signal 9' in lost.reason and isinstance(done, Done) and worker.pid != pid
