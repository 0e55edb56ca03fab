"""
Worker process for long jobs, so that the page stays responsive and can cancel them.

The process starts with the first job and persists between jobs. Cancelling kills it; the next
job starts a new process, which reads the recordings again. `job_state` is its state machine.
"""

from __future__ import annotations

from gravity_comp_ros.workbench import job_state
from gravity_comp_ros.workbench.job_state import Event, Jobs, State, Transition
from gravity_comp_ros.workbench.jobs import Job, JobRunner
from gravity_comp_ros.worker.messages import Done, Failed, Lost, Progress
from gravity_comp_ros.worker.serve import Work
from gravity_comp_ros.worker.worker_process import command, WorkerProcess

_NICENESS = 5


def job_runner() -> Work:
    """Return a function that runs jobs and keeps the recordings between them."""
    return JobRunner().work


class Worker:
    """Runs jobs one after another in a separate process; no method blocks."""

    def __init__(self, warm: bool = False) -> None:
        self.jobs = Jobs()
        self._process = WorkerProcess(command(f'{__name__}:{job_runner.__name__}', _NICENESS))
        self._events: list[Event] = []
        if warm:
            self._process.start()

    @property
    def running(self) -> Job | None:
        """Return the running job, or else the first waiting job."""
        return self.jobs.current

    @property
    def busy(self) -> bool:
        """Return whether a job is running or waiting."""
        return self.running is not None

    @property
    def alive(self) -> bool:
        """Return whether the process exists."""
        return self.pid is not None

    @property
    def pid(self) -> int | None:
        """The process id; None without a process."""
        return self._process.pid

    def ask(self, job: Job) -> None:
        """Submit a job; `poll` returns its events."""
        self._events += self._do(job_state.submitted(self.jobs, job))

    def cancel(self) -> list[Event]:
        """Cancel the running and all waiting jobs."""
        return self._do(job_state.cancelled(self.jobs))

    def rest(self) -> None:
        """End the process if no job is running; the next job starts a new one."""
        if self.jobs.state is State.IDLE and self.alive:
            self._process.end()
            self._do(job_state.process_ended(self.jobs))

    def poll(self) -> list[Event]:
        """Return the events since the last call."""
        events, self._events = self._events, []
        for message in self._process.messages():
            if isinstance(message, Lost):
                events += self._do(job_state.process_ended(self.jobs))
            elif isinstance(message, Progress):
                events.append(message)
            elif isinstance(message, Done):
                events += self._do(job_state.answered(self.jobs, message.answer))
            elif isinstance(message, Failed):
                events += self._do(job_state.answered(self.jobs, None, message.reason))
        return events

    def close(self) -> None:
        """End the process."""
        self._do(job_state.closed(self.jobs))

    def _do(self, move: Transition) -> list[Event]:
        self.jobs = move.jobs
        if move.end:
            self._process.end()
        if move.send is None:
            return list(move.events)
        try:
            if not self.alive:
                self._process.start()
        except OSError:
            # Not enough memory, or too many processes.
            return [*move.events, *self._do(job_state.process_ended(self.jobs))]
        self._process.send(move.send)
        return list(move.events)
