"""
The worker's own end: a process that does one job after another, started by `WorkerProcess`.

It runs as `python3 -m gravity_comp_ros.worker.serve MODULE:FACTORY NICENESS DESCRIPTOR`. The
factory returns what does a job; the descriptor is that of a pipe.
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
from gravity_comp_ros.worker.messages import Done, Failed, Progress, Ready

# Told how far a job is: its stage in words, and a share from 0 to 1.
Tell = Callable[[str, float], None]
# Does a job, and returns its answer.
Work = Callable[[Any, Tell], Any]
# How often the process looks whether the one that started it is still there, in s.
_LOOKS = 0.2


def serve(connection: Connection, work: Work) -> None:
    """Do one job after another until the other side closes the connection."""
    def tell(stage: str, share: float) -> None:
        connection.send(Progress(stage, share))

    connection.send(Ready())
    while True:
        try:
            job = connection.recv()
        except EOFError:
            return
        connection.send(_done(work, job, tell))


def _done(work: Work, job: Any, tell: Tell) -> Done | Failed:
    try:
        return Done(work(job, tell))
    except GravityCompError as problem:
        return Failed(str(problem))
    except (BrokenPipeError, ConnectionResetError):
        raise
    except Exception as problem:
        # A fault of one job is no reason to lose the warm process.
        words = ' '.join(str(problem).split())
        return Failed(f'internal error, please report it: {type(problem).__name__}: {words}')


def _end_with(parent: int) -> None:
    """End this process when its parent is gone, also in the middle of a job."""
    while os.getppid() == parent:
        sleep(_LOOKS)
    os._exit(1)


def main() -> None:
    """Run with the arguments that `WorkerProcess` appends."""
    # Ctrl-C in a terminal reaches the whole group; the other side decides when this ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    task, niceness, descriptor = sys.argv[1:]
    os.nice(int(niceness))
    module, _, factory = task.partition(':')
    try:
        serve(Connection(int(descriptor)), getattr(import_module(module), factory)())
    except (BrokenPipeError, ConnectionResetError):
        pass


if __name__ == '__main__':
    main()
