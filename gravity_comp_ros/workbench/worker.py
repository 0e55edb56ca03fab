"""
A process for long work, so that the page answers while it goes on and can end it.

The process starts with the first job and stays warm between jobs. To cancel it is killed; the
next job starts another one, which reads the recordings again. What may follow what is decided by
`job_state`.
"""

from __future__ import annotations

from gravity_comp_ros.workbench import job_state
from gravity_comp_ros.workbench.job_state import Event, Jobs, Transition, State
from gravity_comp_ros.workbench.jobs import JobRunner, Job
from gravity_comp_ros.worker.messages import Done, Failed, Lost, Progress
from gravity_comp_ros.worker.serve import Work
from gravity_comp_ros.worker.worker_process import command, WorkerProcess

_NICENESS = 5


def benching() -> Work:
    """Return what does the jobs of a page, and keeps what was read between them."""
    return JobRunner().work


class Worker:
    """One job after another in a process of its own. Nothing here blocks."""

    def __init__(self, warm: bool = False) -> None:
        self.jobs = Jobs()
        self._process = WorkerProcess(command(f'{__name__}:{benching.__name__}', _NICENESS))
        self._told: list[Event] = []
        if warm:
            self._process.start()

    @property
    def running(self) -> Job | None:
        """Return the job that is being done or waits first."""
        return self.jobs.current

    @property
    def busy(self) -> bool:
        """Return whether anything is being done or waits."""
        return self.running is not None

    @property
    def alive(self) -> bool:
        """Return whether there is a process."""
        return self.pid is not None

    @property
    def pid(self) -> int | None:
        """The process id, None while there is no process."""
        return self._process.pid

    def ask(self, job: Job) -> None:
        """Do a job when those before it are done; `poll` says how it went."""
        self._told += self._do(job_state.asked(self.jobs, job))

    def cancel(self) -> list[Event]:
        """End what is being done, and forget what waits."""
        return self._do(job_state.cancelled(self.jobs))

    def rest(self) -> None:
        """End the process if nothing is being done; the next job starts another one."""
        if self.jobs.state is State.IDLE and self.alive:
            self._process.end()
            self._do(job_state.died(self.jobs))

    def poll(self) -> list[Event]:
        """Return what has happened since the last call."""
        events, self._told = self._told, []
        for message in self._process.messages():
            if isinstance(message, Lost):
                events += self._do(job_state.died(self.jobs))
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
            # There is no memory for one, or too many processes.
            return [*move.events, *self._do(job_state.died(self.jobs))]
        self._process.send(move.send)
        return list(move.events)
