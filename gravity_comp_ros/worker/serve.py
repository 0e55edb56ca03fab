"""
Main program of a worker process, which does one job after another for a `Worker`.

It runs as `python3 -m gravity_comp_ros.worker.serve MODULE:FACTORY NICENESS DESCRIPTOR`. The
factory returns the job function; the descriptor is that of a pipe.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from multiprocessing.connection import Connection
import os
import signal
import sys
from threading import Thread
from time import sleep
from typing import Any

from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.worker.worker_process import Done, Failed, Progress

# Progress of a job: its stage as text, and a share from 0 to 1.
ProgressCallback = Callable[[str, float], None]
# Job function: from a job to its result.
Work = Callable[[Any, ProgressCallback], Any]
# Period, in s, of the check that the parent process exists.
_PARENT_CHECK_PERIOD = 0.2


def serve(connection: Connection, work: Work) -> None:
    """Do one job after another until the parent closes the connection."""
    def report(stage: str, share: float) -> None:
        connection.send(Progress(stage, share))

    while True:
        try:
            job = connection.recv()
        except EOFError:
            return
        connection.send(_result(work, job, report))


def _result(work: Work, job: Any, report: ProgressCallback) -> Done | Failed:
    try:
        return Done(work(job, report))
    except GravityCompError as problem:
        return Failed(str(problem))
    except (BrokenPipeError, ConnectionResetError):
        raise
    except Exception as problem:
        # After an error in one job the process stays available for the next.
        text = ' '.join(str(problem).split())
        return Failed(f'internal error, please report it: {type(problem).__name__}: {text}')


def _exit_with(parent: int) -> None:
    """Exit when the parent process has ended, also during a job."""
    while os.getppid() == parent:
        sleep(_PARENT_CHECK_PERIOD)
    os._exit(1)


def main() -> None:
    """Run with the arguments that `Worker` appends."""
    # Ctrl-C in a terminal reaches the whole group; only the parent ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_exit_with, args=(os.getppid(),), daemon=True).start()
    task, niceness, descriptor = sys.argv[1:]
    own = os.getpriority(os.PRIO_PROCESS, 0)
    os.setpriority(os.PRIO_PROCESS, 0, max(own, int(niceness)))
    module, _, factory = task.partition(':')
    try:
        serve(Connection(int(descriptor)), getattr(import_module(module), factory)())
    except (BrokenPipeError, ConnectionResetError):
        pass


if __name__ == '__main__':
    main()
