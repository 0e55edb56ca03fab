"""
A process for long work, so that the page answers while it goes on and can end it.

The process stays warm between jobs. To cancel it is killed and another one started, which is
given the recordings again.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
import os
import signal
from typing import Any

from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.workbench.jobs import Answer, Bench, Job, Read, WasRead

_NICENESS = 5


@dataclass(frozen=True)
class Progressed:
    """How far a job is: its stage in words, and a share from 0 to 1."""

    stage: str
    share: float


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


Event = Progressed | Finished | Failed


class Worker:
    """One job after another in a process of its own. Nothing here blocks."""

    def __init__(self) -> None:
        self._process: Any = None
        self._pipe: Connection | None = None
        self._waiting: deque[Job] = deque()
        self._running: Job | None = None
        self._quiet = False
        self._recordings: Read | None = None
        self._start()

    @property
    def running(self) -> Job | None:
        """Return the job that is being done or waits first."""
        return self._running or (self._waiting[0] if self._waiting else None)

    @property
    def busy(self) -> bool:
        """Return whether anything is being done or waits."""
        return self.running is not None

    def ask(self, job: Job) -> None:
        """Do a job when those before it are done."""
        self._waiting.append(job)
        self._next()

    def cancel(self) -> list[Event]:
        """End what is being done, and forget what waits."""
        lost = [job for job in (self._running, *self._waiting) if job is not None]
        if self._running is not None:
            self._kill()
            self._start()
            if self._recordings is not None and not any(isinstance(j, Read) for j in lost):
                # The new process must read them again; nobody waits for that answer.
                self._waiting, self._quiet = deque([self._recordings]), True
                self._next()
                return [Failed(job, 'cancelled', True) for job in lost]
        self._waiting.clear()
        return [Failed(job, 'cancelled', True) for job in lost]

    def poll(self) -> list[Event]:
        """Return what has happened since the last call."""
        events: list[Event] = []
        while self._pipe is not None and self._ready():
            try:
                kind, value = self._pipe.recv()
            except (EOFError, OSError):
                events += self._died()
                break
            if kind == 'progress':
                if not self._quiet:
                    events.append(Progressed(*value))
                continue
            events += self._ended(kind, value)
        return events

    def close(self) -> None:
        """End the process."""
        self._waiting.clear()
        self._kill()

    def _ready(self) -> bool:
        try:
            return self._pipe is not None and self._pipe.poll()
        except (BrokenPipeError, OSError):
            return True

    def _ended(self, kind: str, value: Any) -> list[Event]:
        job, self._running = self._running, None
        quiet, self._quiet = self._quiet, False
        assert job is not None
        if kind == 'done' and isinstance(value, WasRead) and isinstance(job, Read):
            self._recordings = job
        self._next()
        if quiet:
            return []
        return [Finished(job, value) if kind == 'done' else Failed(job, value)]

    def _died(self) -> list[Event]:
        job, self._running, self._quiet = self._running, None, False
        self._kill()
        self._start()
        if self._recordings is not None:
            self._waiting.appendleft(self._recordings)
            self._quiet = True
            self._next()
        return [] if job is None else [
            Failed(job, 'the process that does the work ended (out of memory?); it was started '
                        'again')]

    def _next(self) -> None:
        if self._running is None and self._waiting and self._pipe is not None:
            self._running = self._waiting.popleft()
            try:
                self._pipe.send(self._running)
            except (BrokenPipeError, OSError):
                # `poll` finds the process gone, and starts another.
                pass

    def _start(self) -> None:
        context = get_context('spawn')
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, os.getpid()), daemon=True,
                                        name='gravity_comp workbench')
        self._process.start()
        theirs.close()

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join(5.0)
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = None
        self._running = None


def _serve(pipe: Connection, parent: int) -> None:
    """Do jobs until the other side is gone."""
    # Ctrl-C in a terminal reaches the whole group; the page's process decides when this ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(_NICENESS)
    bench = Bench()

    def progress(stage: str, share: float) -> None:
        pipe.send(('progress', (stage, share)))

    while os.getppid() == parent:
        try:
            job = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            answer = bench.work(job, progress)
            pipe.send(('done', answer))
        except GravityCompError as problem:
            pipe.send(('failed', str(problem)))
        except (BrokenPipeError, ConnectionResetError):
            return
        except Exception as problem:
            # A fault of one job is no reason to lose the warm process.
            pipe.send(('failed', f'internal error, please report it: '
                       f'{type(problem).__name__}: {problem}'))
