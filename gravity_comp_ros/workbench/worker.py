"""
Worker process for long jobs, so that the page stays responsive and can cancel them.

The process starts with the first job and runs one at a time. Cancelling kills it; the next job
starts a new process, which reads the recordings again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from gravity_comp_ros.workbench.jobs import Answer, Job, JobRunner
from gravity_comp_ros.worker.messages import Done, Failed as NotDone, Lost, Progress
from gravity_comp_ros.worker.serve import Work
from gravity_comp_ros.worker.worker_process import command, WorkerProcess

PROCESS_ENDED = 'the worker process ended unexpectedly (out of memory?)'
_NICENESS = 5


@dataclass(frozen=True)
class Finished:
    """A job and its answer."""

    job: Job
    answer: Answer


@dataclass(frozen=True)
class Failed:
    """A job without an answer, and the reason in one line."""

    job: Job
    reason: str


Event = Progress | Finished | Failed


class Works(Protocol):
    """Interface of a worker; no method blocks."""

    job: Job | None

    def start(self, job: Job) -> None:
        """Start a job; `poll` returns its events."""

    def cancel(self) -> None:
        """End the running job without an event."""

    def poll(self) -> list[Event]:
        """Return the events since the last call."""

    def rest(self) -> None:
        """End the process; the next job starts a new one."""


def job_runner() -> Work:
    """Return a function that runs jobs and keeps the recordings between them."""
    return JobRunner().work


class Worker:
    """Runs jobs in a separate process."""

    def __init__(self) -> None:
        self.job: Job | None = None
        self._process = WorkerProcess(command(f'{__name__}:{job_runner.__name__}', _NICENESS))
        self._failed: list[Event] = []

    @property
    def pid(self) -> int | None:
        """The process id; None without a process."""
        return self._process.pid

    def start(self, job: Job) -> None:
        """Start a job; `poll` returns its events."""
        self.job = job
        try:
            if self.pid is None:
                self._process.start()
        except OSError as problem:
            # Not enough memory, or too many processes.
            self.job, reason = None, problem.strerror or 'unknown'
            self._failed.append(Failed(job, f'no worker process can be started: {reason}'))
            return
        self._process.send(job)

    def cancel(self) -> None:
        """End the running job without an event."""
        if self.job is not None:
            self.rest()

    def rest(self) -> None:
        """End the process; the next job starts a new one."""
        self.job, self._failed = None, []
        self._process.end()

    def poll(self) -> list[Event]:
        """Return the events since the last call."""
        events, self._failed = self._failed, []
        for message in self._process.messages():
            job = self.job
            if isinstance(message, Progress):
                events.append(message)
            elif job is not None and isinstance(message, (Done, NotDone, Lost)):
                self.job = None
                events.append(Finished(job, message.answer) if isinstance(message, Done) else
                              Failed(job, message.reason if isinstance(message, NotDone)
                                     else PROCESS_ENDED))
        return events
