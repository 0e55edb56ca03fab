"""Tasks of worker processes in tests, and whether a process is running."""

import os
import signal
import time

from gravity_comp_ros.errors import DataError


def doing():
    """Return a job function; a job is a word and a value."""
    def work(job, report):
        word, value = job
        if word == 'sleep':
            report('sleeping', 0.5)
            time.sleep(value)
        elif word == 'refuse':
            raise DataError(value)
        elif word == 'break':
            raise KeyError(value)
        elif word == 'length':
            return len(value)
        return word

    return work


def failing():
    """Fail before the first job."""
    raise SystemExit(4)


def closing():
    """Return a job function; at a signal the process closes its pipe and remains for a second."""
    def close(number, frame):
        os.closerange(3, 1000)
        time.sleep(1.0)

    signal.signal(signal.SIGUSR1, close)
    return doing()


class LastJob:
    """A job of which a process of `closing` closes its pipe while the job is pickled."""

    def __init__(self, worker):
        self.worker = worker

    def __reduce__(self):
        os.kill(self.worker.pid, signal.SIGUSR1)
        time.sleep(0.1)
        return str, ()


def is_running(pid):
    """Return whether a process is running; a zombie is not."""
    try:
        with open(f'/proc/{pid}/stat') as stream:
            return stream.read().rpartition(')')[2].split()[0] != 'Z'
    except OSError:
        return False
