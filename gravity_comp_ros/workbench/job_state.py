"""
What a worker is doing, as a state machine without a process.

    IDLE       nothing is being done; the process, if there is one, may hold the recordings
    RESTORING  a new process reads the recordings again, because a job waits for them
    WORKING    a job is being done
    CLOSED     nothing will be done any more

Every function takes the jobs as they are and returns a `Move`: the jobs as they are then, what to
tell the process, and what to tell the user. Each job that was asked for ends in exactly one
`Finished` or `Failed`, unless the worker is closed. Recordings that were once asked for are never
forgotten: whatever ends a process, the next job has them read again first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from gravity_comp_ros.workbench.jobs import Answer, Job, Read
from gravity_comp_ros.worker.messages import Progress

DIED = 'the process that did the work ended (out of memory?)'


@dataclass(frozen=True)
class Finished:
    """A job and its answer."""

    job: Job
    answer: Answer


@dataclass(frozen=True)
class Failed:
    """A job that has no answer, and why in one line; `cancelled` if that was asked for."""

    job: Job
    reason: str
    cancelled: bool = False


Event = Progress | Finished | Failed


class State(Enum):
    """See the module."""

    IDLE = 'idle'
    RESTORING = 'restoring'
    WORKING = 'working'
    CLOSED = 'closed'


@dataclass(frozen=True)
class Jobs:
    """
    The state, the job that is done (None unless WORKING), and those that wait.

    `recordings` is the last reading that was asked for, and `held` whether the process has done
    it.
    """

    state: State = State.IDLE
    job: Job | None = None
    waiting: tuple[Job, ...] = ()
    recordings: Read | None = None
    held: bool = False

    @property
    def current(self) -> Job | None:
        """Return the job that a user waits for."""
        return self.job or (self.waiting[0] if self.waiting else None)


@dataclass(frozen=True)
class Transition:
    """The jobs after an event, the job to `send`, whether to end the process, and events."""

    jobs: Jobs
    send: Job | None = None
    end: bool = False
    events: tuple[Event, ...] = ()


def asked(jobs: Jobs, job: Job) -> Transition:
    """Do a job, after those that wait already."""
    if jobs.state is State.CLOSED:
        return Transition(jobs, events=(Failed(job, 'the workbench is closed'),))
    return _begin(replace(jobs, waiting=(*jobs.waiting, job)))


def answered(jobs: Jobs, answer: Answer | None, reason: str = '') -> Transition:
    """Take the answer of the process, or the reason for which there is none (None)."""
    if jobs.state is State.RESTORING:
        if answer is not None:
            return _begin(replace(jobs, state=State.IDLE, held=True))
        return _drop(jobs, reason, cancelled=False, end=False)
    if jobs.state is not State.WORKING or jobs.job is None:
        return Transition(jobs)
    job, held = jobs.job, jobs.held or (isinstance(jobs.job, Read) and answer is not None)
    event: Event = Finished(job, answer) if answer is not None else Failed(job, reason)
    move = _begin(replace(jobs, state=State.IDLE, job=None, held=held))
    return replace(move, events=(event, *move.events))


def died(jobs: Jobs) -> Transition:
    """Take note that the process is gone; what waited behind the lost job is lost as well."""
    if jobs.state is State.CLOSED:
        return Transition(jobs)
    return _drop(jobs, DIED, cancelled=False, end=True)


def cancelled(jobs: Jobs) -> Transition:
    """Give up what is being done and what waits."""
    if jobs.state in (State.IDLE, State.CLOSED):
        return Transition(jobs)
    return _drop(jobs, 'cancelled', cancelled=True, end=True)


def closed(jobs: Jobs) -> Transition:
    """End everything; nobody is there to be told."""
    return Transition(Jobs(State.CLOSED), end=True)


def _begin(jobs: Jobs) -> Transition:
    """Start what waits first, if nothing is being done."""
    if jobs.state is not State.IDLE or not jobs.waiting:
        return Transition(jobs)
    first, rest = jobs.waiting[0], jobs.waiting[1:]
    if isinstance(first, Read):
        working = replace(jobs, state=State.WORKING, job=first, waiting=rest, recordings=first,
                          held=False)
        return Transition(working, send=first)
    if jobs.held:
        return Transition(replace(jobs, state=State.WORKING, job=first, waiting=rest), send=first)
    if jobs.recordings is not None:
        return Transition(replace(jobs, state=State.RESTORING), send=jobs.recordings)
    move = _begin(replace(jobs, waiting=rest))
    return replace(move, events=(Failed(first, 'no recording has been read'), *move.events))


def _drop(jobs: Jobs, reason: str, cancelled: bool, end: bool) -> Transition:
    lost = [job for job in (jobs.job, *jobs.waiting) if job is not None]
    rest = Jobs(State.IDLE, None, (), jobs.recordings, False)
    return Transition(rest, end=end, events=tuple(Failed(job, reason, cancelled) for job in lost))
