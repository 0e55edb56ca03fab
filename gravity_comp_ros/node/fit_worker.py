"""The process that fits, so that the node's own never waits: started by `FitProcess`."""

from __future__ import annotations

import ctypes
from multiprocessing.connection import Connection
import os
import signal
import sys

from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.node.fit_job import work
from gravity_comp_ros.node.fit_messages import Findings, Look, Outcome, Question, Seen
from gravity_comp_ros.node.fit_process import AnyJob
from gravity_comp_ros.node.fit_questions import ask, look

NICENESS = 10
PR_SET_PDEATHSIG = 1


def serve(connection: Connection) -> None:
    """Do one job after another until the other side closes the connection."""
    connection.send(('ready', os.getpid()))
    while True:
        try:
            job = connection.recv()
        except EOFError:
            return
        try:
            connection.send(('done', do(job)))
        except GravityCompError as problem:
            connection.send(('failed', job.number, str(problem)))
        except (ArithmeticError, LookupError, MemoryError, TypeError, ValueError) as problem:
            # A fault of one fit is no reason to lose the warm process.
            connection.send(('failed', job.number, f'{type(problem).__name__}: {problem}'))


def do(job: AnyJob) -> Outcome | Findings | Seen:
    """Do a job of any kind."""
    if isinstance(job, Question):
        return ask(job)
    return look(job) if isinstance(job, Look) else work(job)


def main() -> None:
    """Run as `python3 -m gravity_comp_ros.node.fit_worker DESCRIPTOR`."""
    # Ctrl-C in a terminal reaches the whole group; the node decides when this process ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == 'linux':
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.nice(NICENESS)
    try:
        serve(Connection(int(sys.argv[1])))
    except (BrokenPipeError, ConnectionResetError):
        pass


if __name__ == '__main__':
    main()
