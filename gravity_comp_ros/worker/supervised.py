"""Supervised worker process: kept running, watched, restarted when it dies or hangs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from threading import Thread
from typing import Any

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.worker.messages import Done, Failed, Lost, Message, Ready
from gravity_comp_ros.worker.worker_process import WorkerProcess

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
