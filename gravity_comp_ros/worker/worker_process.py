"""
Worker process for long jobs: start, jobs, messages and end, from the parent's side.

One thread per process starts it, reads its pipe and waits for its end. The caller takes finished
messages from a queue: no method waits for the process, also while it is stopped in the middle of a
message.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
import os
from queue import SimpleQueue
import subprocess
import sys
from threading import Thread
from typing import Any


@dataclass(frozen=True)
class Progress:
    """The progress of a job: its stage as text, and a share from 0 to 1."""

    stage: str
    share: float


@dataclass(frozen=True, eq=False)
class Done:
    """The result of a job."""

    answer: Any


@dataclass(frozen=True)
class Failed:
    """A job without a result: the reason in one line, and whether its process has ended."""

    reason: str
    is_lost: bool = False


Message = Progress | Done | Failed


def command(task: str, niceness: int) -> tuple[str, ...]:
    """
    Return the command line of a worker process with a minimum nice value.

    :param task: 'MODULE:FACTORY'; the factory returns the job function (`serve.Work`).
    """
    return sys.executable, '-m', 'gravity_comp_ros.worker.serve', task, str(niceness)


class Worker:
    """
    Does jobs one after the other in a separate process; no method blocks.

    The process starts with the first job, and with the next one after it was lost or ended. It
    ends with its parent.

    :param command: the command line; the descriptor of the pipe is appended.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._command = tuple(command)
        # Jobs without an answer, the running one first, and what makes the object to send.
        self._jobs: deque[tuple[Any, Callable[[], Any]]] = deque()
        # The process, its messages and the pipe to it.
        self._process: Future[subprocess.Popen[bytes]] | None = None
        self._received: SimpleQueue[Message] = SimpleQueue()
        self._pipe: Connection | None = None

    @property
    def jobs(self) -> list[Any]:
        """The jobs without an answer, the running one first."""
        return [job for job, _ in self._jobs]

    @property
    def job(self) -> Any:
        """The running job, None without one."""
        return self._jobs[0][0] if self._jobs else None

    @property
    def pid(self) -> int | None:
        """The process id, None while there is no process."""
        process = self._process
        is_running = process is not None and process.done() and process.exception() is None
        return process.result().pid if process is not None and is_running else None

    def prepare(self) -> None:
        """Start the process before the first job: it imports its modules meanwhile."""
        if self._process is None:
            self._process, self._received = Future(), SimpleQueue()
            self._pipe, theirs = Pipe()
            Thread(target=_run, daemon=True, args=(
                self._command, self._process, self._received, self._pipe, theirs)).start()

    def start(self, job: Any, make: Callable[[], Any] | None = None) -> None:
        """
        Start a job, after those before it; `poll` returns its messages.

        :param make: returns what is sent to the process instead of the job, in another thread.
        """
        self._jobs.append((job, make or (lambda: job)))
        if len(self._jobs) == 1:
            self._send()

    def cancel(self) -> None:
        """End all jobs without a message."""
        if self._jobs:
            self.rest()

    def rest(self) -> None:
        """End the process and all jobs; the next one starts another process."""
        self._jobs.clear()
        self._end()

    def poll(self) -> list[tuple[Any, Message]]:
        """Return the messages since the last call, each with its job."""
        pairs: list[tuple[Any, Message]] = []
        while self._process is not None and not self._received.empty():
            message = self._received.get()
            if self._jobs:
                pairs.append((self.job, message))
            if isinstance(message, Failed) and message.is_lost:
                self._end()
            if self._jobs and not isinstance(message, Progress):
                self._jobs.popleft()
                if self._jobs:
                    self._send()
        return pairs

    def _send(self) -> None:
        """Send the first job to the process."""
        self.prepare()
        # Writing to a full pipe blocks, so a thread does it.
        Thread(target=_send, daemon=True, args=(
            self._jobs[0][1], self._received, self._pipe)).start()

    def _end(self) -> None:
        if self._process is not None:
            # At once, or when it has started; its thread waits for its end.
            self._process.add_done_callback(_kill)
        self._process = None


def _kill(process: Future[subprocess.Popen[bytes]]) -> None:
    if process.exception() is None:
        process.result().kill()


def _run(command: Sequence[str], started: Future[subprocess.Popen[bytes]],
         received: SimpleQueue[Message], pipe: Connection, theirs: Connection) -> None:
    """Start a process, and pass on its messages until it ends; its loss is the last one."""
    try:
        process = _started(command, theirs)
    except OSError as problem:
        started.set_exception(problem)
        received.put(Failed(f'the worker process cannot be started: {problem.strerror}', True))
        return
    finally:
        theirs.close()
    started.set_result(process)
    # A message cut off by the end of its process is lost with it.
    with suppress(Exception):
        while True:
            received.put(pipe.recv())
    try:
        # On a busy machine a process ends some time after its pipe.
        code = process.wait(timeout=2.0)
        how = f'signal {-code}; out of memory?' if code < 0 else f'exit code {code}'
    except subprocess.TimeoutExpired:
        how = 'it closed its pipe'
    received.put(Failed(f'the worker process died ({how})', True))
    process.wait()


def _send(make_job: Callable[[], Any], received: SimpleQueue[Message], pipe: Connection) -> None:
    try:
        pipe.send(make_job())
    except OSError:
        # The other end is closed, which the reading thread reports.
        pass
    except Exception as problem:
        received.put(Failed(f'the job cannot be sent: {type(problem).__name__}: {problem}'))


def _started(command: Sequence[str], pipe: Connection) -> subprocess.Popen[bytes]:
    """
    Start a process with default scheduling, also from a thread with real-time priority.

    :raises OSError: if it cannot be started.
    """
    if hasattr(os, 'SCHED_RESET_ON_FORK'):
        # For the children of this thread alone.
        os.sched_setscheduler(0, os.sched_getscheduler(0) | os.SCHED_RESET_ON_FORK,
                              os.sched_getparam(0))
    # The worker must import the same package, also if sys.path was changed.
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(p for p in sys.path if p),
                   'OPENBLAS_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}
    return subprocess.Popen(
        [*command, str(pipe.fileno())], pass_fds=[pipe.fileno()], stdin=subprocess.DEVNULL,
        env=environment, start_new_session=True)
