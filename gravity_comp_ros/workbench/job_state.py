"""
State machine of a worker, without a process.

    IDLE       no job is running; the process, if any, may have read the recordings
    RESTORING  a new process reads the recordings again for a waiting job
    WORKING    a job is running
    CLOSED     final state

Every function takes the current `Jobs` and returns a `Transition`: the new jobs, the message to
the process, and the events for the page. Each submitted job ends in exactly one `Finished` or
`Failed`, unless the worker is closed. After the end of a process, the next job first reads the
last recordings again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from gravity_comp_ros.workbench.jobs import Answer, Job, Read
from gravity_comp_ros.worker.messages import Progress

PROCESS_ENDED = 'the worker process ended unexpectedly (out of memory?)'


@dataclass(frozen=True)
class Finished:
    """A job and its answer."""

    job: Job
    answer: Answer


@dataclass(frozen=True)
class Failed:
    """A job without an answer, and the reason in one line; `cancelled` on request."""

    job: Job
    reason: str
    cancelled: bool = False


Event = Progress | Finished | Failed


class State(Enum):
    """States of a worker; see the module."""

    IDLE = 'idle'
    RESTORING = 'restoring'
    WORKING = 'working'
    CLOSED = 'closed'


@dataclass(frozen=True)
class Jobs:
    """
    State, running job (None unless WORKING), and waiting jobs.

    `recordings` is the last submitted reading; `recordings_read` is whether the process has
    finished it.
    """

    state: State = State.IDLE
    job: Job | None = None
    waiting: tuple[Job, ...] = ()
    recordings: Read | None = None
    recordings_read: bool = False

    @property
    def current(self) -> Job | None:
        """Return the running job, or else the first waiting job."""
        return self.job or (self.waiting[0] if self.waiting else None)


@dataclass(frozen=True)
class Transition:
    """The jobs after an event, a job to `send`, whether to end the process, and events."""

    jobs: Jobs
    send: Job | None = None
    end: bool = False
    events: tuple[Event, ...] = ()


def submitted(jobs: Jobs, job: Job) -> Transition:
    """Submit a job, after the waiting jobs."""
    if jobs.state is State.CLOSED:
        return Transition(jobs, events=(Failed(job, 'the workbench is closed'),))
    return _begin(replace(jobs, waiting=(*jobs.waiting, job)))


def answered(jobs: Jobs, answer: Answer | None, reason: str = '') -> Transition:
    """Process an answer; without an answer (None), the reason of the failure."""
    if jobs.state is State.RESTORING:
        if answer is not None:
            return _begin(replace(jobs, state=State.IDLE, recordings_read=True))
        return _drop(jobs, reason, cancelled=False, end=False)
    if jobs.state is not State.WORKING or jobs.job is None:
        return Transition(jobs)
    job = jobs.job
    recordings_read = jobs.recordings_read or (isinstance(job, Read) and answer is not None)
    event: Event = Finished(job, answer) if answer is not None else Failed(job, reason)
    move = _begin(replace(jobs, state=State.IDLE, job=None, recordings_read=recordings_read))
    return replace(move, events=(event, *move.events))


def process_ended(jobs: Jobs) -> Transition:
    """Process the end of the process; the running and all waiting jobs fail."""
    if jobs.state is State.CLOSED:
        return Transition(jobs)
    return _drop(jobs, PROCESS_ENDED, cancelled=False, end=True)


def cancelled(jobs: Jobs) -> Transition:
    """Cancel the running and all waiting jobs."""
    if jobs.state in (State.IDLE, State.CLOSED):
        return Transition(jobs)
    return _drop(jobs, 'cancelled', cancelled=True, end=True)


def closed(jobs: Jobs) -> Transition:
    """Close the worker, without events."""
    return Transition(Jobs(State.CLOSED), end=True)


def _begin(jobs: Jobs) -> Transition:
    """Start the first waiting job if no job is running."""
    if jobs.state is not State.IDLE or not jobs.waiting:
        return Transition(jobs)
    first, rest = jobs.waiting[0], jobs.waiting[1:]
    if isinstance(first, Read):
        working = replace(jobs, state=State.WORKING, job=first, waiting=rest, recordings=first,
                          recordings_read=False)
        return Transition(working, send=first)
    if jobs.recordings_read:
        return Transition(replace(jobs, state=State.WORKING, job=first, waiting=rest), send=first)
    if jobs.recordings is not None:
        return Transition(replace(jobs, state=State.RESTORING), send=jobs.recordings)
    move = _begin(replace(jobs, waiting=rest))
    return replace(move, events=(Failed(first, 'no recording has been read'), *move.events))


def _drop(jobs: Jobs, reason: str, cancelled: bool, end: bool) -> Transition:
    lost = [job for job in (jobs.job, *jobs.waiting) if job is not None]
    rest = Jobs(State.IDLE, None, (), jobs.recordings, False)
    return Transition(rest, end=end, events=tuple(Failed(job, reason, cancelled) for job in lost))
