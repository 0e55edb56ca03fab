"""A process that does long work, seen from the one that started it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
import os
import subprocess
import sys
from threading import Thread
from typing import Any

from gravity_comp_ros.worker.messages import Lost, Message


def command(task: str, niceness: int) -> tuple[str, ...]:
    """
    Return how to start a process that does a task.

    :param task: 'MODULE:FACTORY'; the factory returns what does a job (`serve.Work`).
    :param niceness: by how much its priority is lower.
    """
    return sys.executable, '-m', 'gravity_comp_ros.worker.serve', task, str(niceness)


class WorkerProcess:
    """
    A process of its own and the pipe to it. Nothing here waits for it.

    It stays warm between jobs. It ends with the process that started it.

    :param command: how to start the process; the descriptor of its pipe is appended.
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
        Start the process; `Ready` says when it takes a job.

        :raises OSError: if it cannot be started.
        """
        ours, theirs = Pipe()
        # A process started with sys.path changed must find the same package.
        environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(p for p in sys.path if p),
                       'OPENBLAS_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}
        try:
            with _plain_children():
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
        """Give the process a job."""
        if self._connection is not None:
            # A pipe that nobody empties blocks its writer, and this process must not wait.
            Thread(target=_send, args=(self._connection, job), daemon=True).start()

    def messages(self) -> list[Message]:
        """Return what the process has said since the last call; `Lost` is the last of all."""
        found: list[Message] = []
        try:
            while self._connection is not None and self._connection.poll():
                found.append(self._connection.recv())
        except (EOFError, OSError):
            found.append(Lost(self._exit_text()))
            self.end()
        return found

    def end(self) -> None:
        """Kill the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            # Killed all the same; a process stuck in the kernel must not hold this one up.
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


@contextmanager
def _plain_children() -> Iterator[None]:
    """Let a child have the priority of any process, where this one has that of control."""
    if not hasattr(os, 'SCHED_RESET_ON_FORK'):
        yield
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, parameters)
    try:
        yield
    finally:
        # Only the privileged may take it back; for others it stays, which does no harm.
        with suppress(PermissionError):
            os.sched_setscheduler(0, policy, parameters)


def _send(connection: Connection, job: Any) -> None:
    try:
        connection.send(job)
    except (OSError, ValueError):
        # The other end is gone, which `messages` will see; or this end was closed meanwhile.
        pass
