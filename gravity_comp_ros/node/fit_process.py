"""The node's end of the fit process: kept warm, watched, and replaced when it dies or hangs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.node.fit_messages import Findings, Job, Look, Outcome, Question, Seen
from gravity_comp_ros.worker.messages import Done, Failed, Lost, Message, Ready
from gravity_comp_ros.worker.worker_process import command as worker_command, WorkerProcess

STARTING = 'starting'
READY = 'ready'
BUSY = 'fitting'
DOWN = 'down'

NICENESS = 10
START_TIMEOUT = 60.0
FIRST_DELAY = 0.5
LONGEST_DELAY = 30.0


@dataclass(frozen=True)
class Failure:
    """A fit that ended without a model; `lost` says that its process went with it."""

    reason: str
    number: int | None
    lost: bool


AnyJob = Job | Question | Look
Event = Outcome | Findings | Seen | Failure


class FitProcess:
    """
    One fit at a time in a process of its own. Nothing here blocks, time is explicit.

    :param timeout: s after which a fit counts as hanging.
    :param command: how to start the process; the descriptor of its pipe is appended.
    """

    def __init__(self, timeout: float, command: Sequence[str] = worker_command(
            'gravity_comp_ros.node.fit_worker:fitting', NICENESS)) -> None:
        self.timeout = timeout
        self.restarts = 0
        self.last_failure = ''
        self.state = DOWN
        self._worker = WorkerProcess(command)
        # What is being done, if anything.
        self.job: AnyJob | None = None
        self._since = 0.0
        self._delay = FIRST_DELAY
        self._start_at = 0.0

    @property
    def pid(self) -> int | None:
        """The process id, None while there is no process."""
        return self._worker.pid

    def seconds(self, now: float) -> float:
        """Return for how long the present state has lasted."""
        return now - self._since

    def start(self, now: float) -> None:
        """Start the process; it says by itself when it is ready."""
        try:
            self._worker.start()
        except OSError as problem:
            self._fail(f'the fit process cannot be started: {problem}', now)
            return
        self.state, self._since = STARTING, now

    def submit(self, job: AnyJob, now: float) -> bool:
        """Give the process a job; False if it is not ready for one."""
        if self.state != READY:
            return False
        self.job, self.state, self._since = job, BUSY, now
        self._worker.send(job)
        return True

    def poll(self, now: float) -> list[Event]:
        """Return what happened since the last call; restarts a process that was lost."""
        if self.state == DOWN:
            if now >= self._start_at:
                self.start(now)
            return []
        events: list[Event] = []
        for message in self._worker.messages():
            if isinstance(message, Lost):
                return [*events, self._lose(f'the fit process died ({message.how})', now)]
            events += self._take(message, now)
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

    def _take(self, message: Message, now: float) -> list[Event]:
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
        # One that dies as it starts is not to be started a hundred times a second.
        self._start_at = now + self._delay
        self._delay = min(2 * self._delay, LONGEST_DELAY)
