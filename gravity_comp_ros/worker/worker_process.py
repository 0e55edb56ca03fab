"""
Worker process for long jobs: start, jobs, messages and end, from the parent's side.

One thread per process starts it, reads its pipe and waits for its end. The caller takes finished
messages from a queue: no method waits for the process, also while it is stopped in the middle of a
message.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
import math
from multiprocessing import Pipe
from multiprocessing.connection import Connection
import os
from queue import SimpleQueue
import subprocess
import sys
from threading import Thread
from typing import Any


@dataclass(frozen=True)
class Ready:
    """The process has imported its modules and accepts jobs."""


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


Message = Ready | Progress | Done | Failed


def command(task: str, niceness: int) -> tuple[str, ...]:
    """
    Return the command line of a worker process with a minimum nice value.

    :param task: 'MODULE:FACTORY'; the factory returns the job function (`serve.Work`).
    """
    return sys.executable, '-m', 'gravity_comp_ros.worker.serve', task, str(niceness)


class WorkerProcess:
    """
    A worker process, which keeps running between jobs and ends with its parent process.

    It starts at once; it accepts jobs after `Ready`.

    :param command: the command line; the descriptor of the pipe is appended.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._is_ended = False
        self._connection, theirs = Pipe()
        self._received: SimpleQueue[Message] = SimpleQueue()
        Thread(target=self._run, args=(tuple(command), theirs), daemon=True).start()

    @property
    def pid(self) -> int | None:
        """The process id, None while there is no process."""
        return self._process.pid if self._process and not self._is_ended else None

    def send(self, make_job: Callable[[], Any]) -> None:
        """Send a job to the process; another thread makes it."""
        # Writing to a full pipe blocks, so a thread does it.
        Thread(target=self._send, args=(make_job,), daemon=True).start()

    def messages(self) -> list[Message]:
        """Return the messages since the last call; the loss of the process is the last of all."""
        received: list[Message] = []
        while not self._is_ended and not self._received.empty():
            message = self._received.get()
            received.append(message)
            self._is_ended = isinstance(message, Failed) and message.is_lost
        return received

    def end(self) -> None:
        """Kill the process; its thread waits for its end."""
        self._is_ended = True
        if self._process is not None:
            self._process.kill()

    def _run(self, command: Sequence[str], theirs: Connection) -> None:
        """Start the process, and pass on its messages until it ends."""
        try:
            self._process = process = _started(command, theirs)
        except OSError as problem:
            self._received.put(Failed(f'cannot be started: {problem.strerror}', True))
            return
        finally:
            theirs.close()
        if self._is_ended:
            process.kill()
        # A message cut off by the end of its process is lost with it.
        with suppress(Exception):
            while True:
                self._received.put(self._connection.recv())
        try:
            # On a busy machine a process ends some time after its pipe.
            code = process.wait(timeout=2.0)
            how = f'signal {-code}' if code < 0 else f'exit code {code}'
        except subprocess.TimeoutExpired:
            how = 'it closed its pipe'
        self._received.put(Failed(f'died ({how})', True))
        process.wait()

    def _send(self, make_job: Callable[[], Any]) -> None:
        try:
            self._connection.send(make_job())
        except OSError:
            # The other end is closed, which the reading thread reports.
            pass
        except Exception as problem:
            self._received.put(Failed(
                f'the job cannot be sent: {type(problem).__name__}: {problem}'))


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


STARTING, READY, BUSY, DOWN = 'starting', 'ready', 'fitting', 'down'
# Shortest timeout of the start of a process, and delay of the start after a loss, s: a process that
# dies as it starts must not occupy the machine.
START_TIMEOUT, RESTART_DELAY = 60.0, 2.0


class Supervised:
    """
    One job at a time in a separate process. No method blocks; the caller passes the time in s.

    `job` is the running one, `last_loss` the reason of the last loss of the process.

    :param command: command of the process (`worker_process.command`).
    :param timeout: time after which a job counts as hanging, s.
    """

    def __init__(self, command: Sequence[str], timeout: float) -> None:
        self.timeout, self.restarts, self.last_loss = timeout, 0, ''
        self._command = tuple(command)
        self._worker: WorkerProcess | None = None
        self._enter(DOWN, -math.inf)

    @property
    def pid(self) -> int | None:
        """The process id, None while there is no process."""
        return None if self._worker is None else self._worker.pid

    def seconds(self, now: float) -> float:
        """Return the duration of the present state in s."""
        return now - self._since

    def submit(self, job: Any, now: float, make: Callable[[], Any]) -> bool:
        """
        Send what `make` returns to the process; return False if it is not ready.

        Another thread calls `make`. `poll` returns the `job` with the result.
        """
        if self.state != READY or self._worker is None:
            return False
        self._enter(BUSY, now, job)
        self._worker.send(make)
        return True

    def poll(self, now: float) -> list[tuple[Any, Any]]:
        """
        Return each job that has ended, with its result or `Failed`; start a missing process.

        The job is None where the process was lost without one.
        """
        if self._worker is None:
            if self.seconds(now) >= RESTART_DELAY:
                self._enter(STARTING, now)
                self._worker = WorkerProcess(self._command)
            return []
        events: list[tuple[Any, Any]] = []
        for message in self._worker.messages():
            if isinstance(message, Failed) and message.is_lost:
                return [*events, self._lose(message.reason, now)]
            if isinstance(message, (Done, Failed)):
                events.append((self.job, message.answer if isinstance(message, Done) else message))
            if not isinstance(message, Progress):
                self._enter(READY, now)
        limit = max(self.timeout, START_TIMEOUT * (self.state == STARTING))
        if self.state != READY and self.seconds(now) > limit:
            events.append(self._lose(
                f'hung and was killed: no answer after {self.seconds(now):.1f} s', now))
        return events

    def stop(self) -> None:
        """End the process; none is started again."""
        self._end(math.inf)

    def _lose(self, reason: str, now: float) -> tuple[Any, Failed]:
        job, self.restarts = self.job, self.restarts + 1
        self.last_loss = f'the fit process {reason}'
        self._end(now)
        return job, Failed(self.last_loss, is_lost=True)

    def _end(self, now: float) -> None:
        if self._worker is not None:
            self._worker.end()
        self._worker = None
        self._enter(DOWN, now)

    def _enter(self, state: str, now: float, job: Any = None) -> None:
        self.state, self._since, self.job = state, now, job
