"""Worker process for long jobs: start, jobs, messages and end, from the parent's side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
import os
import subprocess
import sys
from threading import Thread
from typing import Any

from gravity_comp_ros.worker.messages import Lost, Message


def command(task: str, niceness: int) -> tuple[str, ...]:
    """
    Return the command line of a worker process, without the pipe's descriptor.

    :param task: 'MODULE:FACTORY'; the factory returns the job function (`serve.Work`).
    :param niceness: increment of the process's nice value.
    """
    return sys.executable, '-m', 'gravity_comp_ros.worker.serve', task, str(niceness)


class WorkerProcess:
    """
    A worker process and the pipe to it. No method blocks on it.

    It keeps running between jobs and ends with its parent process.

    :param command: the command line; the descriptor of the pipe is appended.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._command = tuple(command)
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None

    @property
    def pid(self) -> int | None:
        """The process id, None while there is no process."""
        return self._process.pid if self._process else None

    def start(self) -> None:
        """
        Start the process; it accepts jobs after `Ready`.

        :raises OSError: if it cannot be started.
        """
        ours, theirs = Pipe()
        # The worker must import the same package, also if sys.path was changed.
        environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(p for p in sys.path if p),
                       'OPENBLAS_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}
        try:
            with _default_child_priority():
                self._process = subprocess.Popen(
                    [*self._command, str(theirs.fileno())], pass_fds=[theirs.fileno()],
                    stdin=subprocess.DEVNULL, env=environment, start_new_session=True)
        except OSError:
            ours.close()
            raise
        finally:
            theirs.close()
        self._connection = ours

    def send(self, job: Any) -> None:
        """Send a job to the process."""
        if self._connection is not None:
            # Writing to a full pipe blocks, so a thread does it.
            Thread(target=_send, args=(self._connection, job), daemon=True).start()

    def messages(self) -> list[Message]:
        """Return the messages since the last call; `Lost` is the last of all."""
        received: list[Message] = []
        try:
            while self._connection is not None and self._connection.poll():
                received.append(self._connection.recv())
        except (EOFError, OSError):
            received.append(Lost(self._exit_text()))
            self.end()
        return received

    def end(self) -> None:
        """Kill the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            # A process blocked in the kernel ends later; this one must not wait for it.
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=0.5)
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = None

    def _exit_text(self) -> str:
        code = None
        if self._process is not None:
            try:
                code = self._process.wait(timeout=0.2)
            except subprocess.TimeoutExpired:
                return 'it closed its pipe'
        return f'signal {-code}' if code is not None and code < 0 else f'exit code {code}'


def wait_for_messages(workers: Sequence[WorkerProcess]) -> list[WorkerProcess]:
    """Return the running workers with messages; wait until there is one."""
    connections = {worker._connection: worker for worker in workers}
    ready = wait([connection for connection in connections if connection is not None])
    return [worker for connection, worker in connections.items() if connection in ready]


@contextmanager
def _default_child_priority() -> Iterator[None]:
    """Start children with default scheduling, also from a process with real-time priority."""
    if not hasattr(os, 'SCHED_RESET_ON_FORK'):
        yield
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, parameters)
    try:
        yield
    finally:
        # Resetting the flag requires a privilege; without it the flag stays, without harm.
        with suppress(PermissionError):
            os.sched_setscheduler(0, policy, parameters)


def _send(connection: Connection, job: Any) -> None:
    try:
        connection.send(job)
    except (OSError, ValueError):
        # The process has ended, which `messages` reports, or this end has been closed.
        pass
