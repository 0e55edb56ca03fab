"""Supervision of the fit process: kept running, watched, restarted when it dies or hangs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.node.fit_messages import (
    DiagnosisJob, DiagnosisResult, FitJob, FitResult, PayloadJob, PayloadResult)
from gravity_comp_ros.worker.messages import Done, Failed, Lost, Message, Ready
from gravity_comp_ros.worker.worker_process import command as worker_command, WorkerProcess

STARTING = 'starting'
READY = 'ready'
BUSY = 'fitting'
DOWN = 'down'

NICENESS = 10
# Time after which a process that does not start is killed, s.
START_TIMEOUT = 60.0
# First and largest delay before a restart, s; it doubles with each failure.
FIRST_DELAY, MAX_DELAY = 0.5, 30.0


@dataclass(frozen=True)
class Failure:
    """A job that ended without a result; `lost` is true if its process ended as well."""

    reason: str
    number: int | None
    lost: bool


AnyJob = FitJob | DiagnosisJob | PayloadJob
Event = FitResult | DiagnosisResult | PayloadResult | Failure


class FitProcess:
    """
    One job at a time in a separate process. No method blocks; the caller passes the time in s.

    :param timeout: time after which a job counts as hanging, s.
    :param command: command of the process; the descriptor of its pipe is appended.
    """

    def __init__(self, timeout: float, command: Sequence[str] = worker_command(
            'gravity_comp_ros.node.fit_worker:fitting', NICENESS)) -> None:
        self.timeout = timeout
        self.restarts = 0
        self.last_failure = ''
        self.state = DOWN
        self._worker = WorkerProcess(command)
        # The running job.
        self.job: AnyJob | None = None
        self._since = 0.0
        self._delay = FIRST_DELAY
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
        try:
            self._worker.start()
        except OSError as problem:
            self._fail(f'the fit process cannot be started: {problem}', now)
            return
        self.state, self._since = STARTING, now

    def submit(self, job: AnyJob, now: float) -> bool:
        """Send a job to the process; return False if it is not ready."""
        if self.state != READY:
            return False
        self.job, self.state, self._since = job, BUSY, now
        self._worker.send(job)
        return True

    def poll(self, now: float) -> list[Event]:
        """Return the events since the last call; restart a process that was lost."""
        if self.state == DOWN:
            if now >= self._start_at:
                self.start(now)
            return []
        events: list[Event] = []
        for message in self._worker.messages():
            if isinstance(message, Lost):
                return [*events, self._lose(f'the fit process died ({message.how})', now)]
            events += self._receive(message, now)
        waited = now - self._since
        if self.state == BUSY and waited > self.timeout:
            return [*events, self._lose(f'the fit hung: no result after {waited:.1f} s; its '
                                        'process was killed', now)]
        if self.state == STARTING and waited > START_TIMEOUT:
            return [*events, self._lose('the fit process did not start within '
                                        f'{START_TIMEOUT:g} s', now)]
        return events

    def stop(self) -> None:
        """End the process."""
        self._worker.end()
        self.state, self.job = DOWN, None
        self._start_at = float('inf')

    def _receive(self, message: Message, now: float) -> list[Event]:
        number, events = self.job.number if self.job else None, list[Event]()
        if isinstance(message, Ready):
            self._delay = FIRST_DELAY
        elif isinstance(message, Done):
            events.append(message.answer)
        elif isinstance(message, Failed):
            self.last_failure = message.reason
            events.append(Failure(message.reason, number, lost=False))
        else:
            return events
        self.job, self.state, self._since = None, READY, now
        return events

    def _lose(self, reason: str, now: float) -> Failure:
        number = self.job.number if self.job else None
        self._worker.end()
        self._fail(reason, now)
        return Failure(reason, number, lost=True)

    def _fail(self, reason: str, now: float) -> None:
        self.restarts += 1
        self.last_failure = reason
        self.job, self.state, self._since = None, DOWN, now
        # A process that dies as it starts must not be restarted at every poll.
        self._start_at = now + self._delay
        self._delay = min(2 * self._delay, MAX_DELAY)
