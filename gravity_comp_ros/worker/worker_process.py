"""
Worker process for long jobs: start, jobs, messages and end, from the parent's side.

One thread per process reads its pipe and waits for its end. The caller takes finished messages
from a queue: no method waits for the process, also while it is stopped in the middle of a message.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
import os
from queue import SimpleQueue
import subprocess
import sys
from threading import Lock, Thread
from typing import Any

from gravity_comp_ros.errors import OptionError


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
    """The reason of a job's failure, in one line."""

    reason: str


@dataclass(frozen=True)
class Lost:
    """The process has ended; `how` is its exit status as text."""

    how: str


Message = Ready | Progress | Done | Failed | Lost


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


STARTING = 'starting'
READY = 'ready'
BUSY = 'fitting'
DOWN = 'down'


@dataclass(frozen=True)
class Failure:
    """A job ended without a result; `lost` is true if its process ended as well."""

    reason: str
    lost: bool


@dataclass(frozen=True)
class RestartOptions:
    """
    Times of the supervision in s.

    A process that is not ready after `start_timeout` is killed. After a loss it is started again
    with a delay of `first_delay`, which doubles with each loss up to `max_delay`, so that a
    process that dies as it starts does not occupy the machine.

    :raises OptionError: if a time is not positive.
    """

    start_timeout: float = 60.0
    first_delay: float = 0.5
    max_delay: float = 30.0

    def __post_init__(self) -> None:
        if min(self.start_timeout, self.first_delay, self.max_delay) <= 0.0:
            raise OptionError('worker: times of the supervision must be positive')


class Supervised:
    """
    One job at a time in a separate process. No method blocks; the caller passes the time in s.

    :param command: command of the process (`worker_process.command`).
    :param timeout: time after which a job counts as hanging, s.
    """

    def __init__(self, command: Sequence[str], timeout: float,
                 options: RestartOptions = RestartOptions()) -> None:
        self.timeout = timeout
        self.restarts = 0
        # Reason of the last loss of the process.
        self.last_loss = ''
        self.state = DOWN
        # The running job.
        self.job: Any = None
        self._options, self._command = options, tuple(command)
        self._worker = WorkerProcess(command)
        self._start_problem = ''
        self._since = 0.0
        self._delay = options.first_delay
        self._start_at = 0.0

    @property
    def pid(self) -> int | None:
        """The process id, None while there is no process."""
        return self._worker.pid

    def seconds(self, now: float) -> float:
        """Return the duration of the present state in s."""
        return now - self._since

    def start(self, now: float) -> None:
        """Start the process; `poll` receives its message that it is ready."""
        self.state, self._since, self._start_problem = STARTING, now, ''
        self._worker = WorkerProcess(self._command)
        # A busy machine takes milliseconds to start a process.
        Thread(target=self._launch, args=(self._worker,), daemon=True).start()

    def submit(self, job: Any, now: float, prepare: Callable[[Any], Any] | None = None) -> bool:
        """
        Send a job to the process; return False if it is not ready.

        :param job: `poll` returns it with the result.
        :param prepare: called in another thread with the job; what it returns is sent instead.
        """
        if self.state != READY:
            return False
        self.job, self.state, self._since = job, BUSY, now
        self._worker.send(job, prepare)
        return True

    def poll(self, now: float) -> list[tuple[Any, Any]]:
        """
        Return each job that has ended, with its result or `Failure`; restart a lost process.

        The job is None where the process was lost without one.
        """
        if self.state == DOWN:
            if now >= self._start_at:
                self.start(now)
            return []
        events: list[tuple[Any, Any]] = []
        if self._start_problem:
            return [self._lose(f'the fit process cannot be started: {self._start_problem}', now)]
        for message in self._worker.messages():
            if isinstance(message, Lost):
                return [*events, self._lose(f'the fit process died ({message.how})', now)]
            events += self._receive(message, now)
        waited = now - self._since
        if self.state == BUSY and waited > self.timeout:
            return [*events, self._lose(f'the fit hung: no result after {waited:.1f} s; its '
                                        'process was killed', now)]
        if self.state == STARTING and waited > self._options.start_timeout:
            return [*events, self._lose('the fit process did not start within '
                                        f'{self._options.start_timeout:g} s', now)]
        return events

    def stop(self) -> None:
        """End the process."""
        worker, self._worker = self._worker, WorkerProcess(self._command)
        worker.end()
        self.state, self.job = DOWN, None
        self._start_at = float('inf')

    def _launch(self, worker: WorkerProcess) -> None:
        try:
            worker.start()
        except OSError as problem:
            self._start_problem = str(problem)
        if worker is not self._worker:
            # Stopped in the meantime.
            worker.end()

    def _receive(self, message: Message, now: float) -> list[tuple[Any, Any]]:
        events: list[tuple[Any, Any]] = []
        if isinstance(message, Ready):
            self._delay = self._options.first_delay
        elif isinstance(message, Done):
            events.append((self.job, message.answer))
        elif isinstance(message, Failed):
            events.append((self.job, Failure(message.reason, lost=False)))
        else:
            return events
        self.job, self.state, self._since = None, READY, now
        return events

    def _lose(self, reason: str, now: float) -> tuple[Any, Failure]:
        job, worker, self._worker = self.job, self._worker, WorkerProcess(self._command)
        worker.end()
        self.restarts += 1
        self.last_loss = reason
        self.job, self.state, self._since = None, DOWN, now
        self._start_at = now + self._delay
        self._delay = min(2 * self._delay, self._options.max_delay)
        return job, Failure(reason, lost=True)
