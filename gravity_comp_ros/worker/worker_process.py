"""
Worker process for long jobs: start, jobs, messages and end, from the parent's side.

One thread per process reads its pipe and waits for its end. The caller takes finished messages
from a queue: no method waits for the process, also while it is stopped in the middle of a message.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
import os
from queue import SimpleQueue
import subprocess
import sys
from threading import Lock, Thread
from typing import Any

from gravity_comp_ros.worker.messages import Failed, Lost, Message


def command(task: str, niceness: int) -> tuple[str, ...]:
    """
    Return the command line of a worker process, without the pipe's descriptor.

    :param task: 'MODULE:FACTORY'; the factory returns the job function (`serve.Work`).
    :param niceness: minimum nice value of the process.
    """
    return sys.executable, '-m', 'gravity_comp_ros.worker.serve', task, str(niceness)


class WorkerProcess:
    """
    A worker process, which keeps running between jobs and ends with its parent process.

    :param command: the command line; the descriptor of the pipe is appended.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._command = tuple(command)
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None
        # Held while a job is sent: the pipe is not closed within it.
        self._sending = Lock()
        self._received: SimpleQueue[Message] = SimpleQueue()

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
                process = subprocess.Popen(
                    [*self._command, str(theirs.fileno())], pass_fds=[theirs.fileno()],
                    stdin=subprocess.DEVNULL, env=environment, start_new_session=True)
        except OSError:
            ours.close()
            raise
        finally:
            theirs.close()
        # Messages of an earlier process stay in its own queue.
        self._process, self._connection, self._received = process, ours, SimpleQueue()
        self._sending = Lock()
        Thread(target=_read, args=(process, ours, self._sending, self._received),
               daemon=True).start()

    def send(self, job: Any, prepare: Callable[[Any], Any] | None = None) -> None:
        """
        Send a job to the process.

        :param prepare: called in another thread; the job is what it returns.
        """
        if self._connection is not None:
            # Writing to a full pipe blocks, so a thread does it.
            Thread(target=_send, args=(self._connection, self._sending, self._received, job,
                                       prepare), daemon=True).start()

    def messages(self) -> list[Message]:
        """Return the messages since the last call; `Lost` is the last of all."""
        received: list[Message] = []
        while not self._received.empty():
            received.append(self._received.get())
            if isinstance(received[-1], Lost):
                self.end()
        return received

    def end(self) -> None:
        """Kill the process, if there is one; its thread waits for its end."""
        if self._process is not None:
            self._process.kill()
        self._process = self._connection = None
        self._received = SimpleQueue()


def _read(process: subprocess.Popen[bytes], connection: Connection, sending: Lock,
          received: SimpleQueue[Message]) -> None:
    """Pass on the messages of a process until it ends."""
    # A message cut off by the end of its process is lost with it.
    with suppress(Exception):
        while True:
            received.put(connection.recv())
    # A job that is being sent fails as soon as the other end is closed.
    with sending:
        connection.close()
    try:
        # On a busy machine a process ends some time after its pipe.
        code = process.wait(timeout=2.0)
        how = f'signal {-code}' if code < 0 else f'exit code {code}'
    except subprocess.TimeoutExpired:
        how = 'it closed its pipe'
    received.put(Lost(how))
    process.wait()


def _send(connection: Connection, sending: Lock, received: SimpleQueue[Message], job: Any,
          prepare: Callable[[Any], Any] | None) -> None:
    try:
        prepared = job if prepare is None else prepare(job)
        with sending:
            connection.send(prepared)
    except OSError:
        # The process has ended, which its reading thread reports.
        pass
    except Exception as problem:
        received.put(Failed(f'the job cannot be sent: {type(problem).__name__}: {problem}'))


@contextmanager
def _default_child_priority() -> Iterator[None]:
    """Start children with default scheduling, also from a thread with real-time priority."""
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
