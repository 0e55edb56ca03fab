"""
A process for long work, so that the page answers while it goes on and can end it.

The process starts with the first job and stays warm between jobs. To cancel it is killed; the
next job starts another one, which reads the recordings again. What may follow what is decided by
`job_state`; here are only the process and its pipe.
"""

from __future__ import annotations

from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
import os
import signal
from typing import Any

from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.workbench import job_state
from gravity_comp_ros.workbench.job_state import Event, Jobs, Move, Progressed, State
from gravity_comp_ros.workbench.jobs import Bench, Job

_NICENESS = 5


class Worker:
    """One job after another in a process of its own. Nothing here blocks."""

    def __init__(self, warm: bool = False) -> None:
        self.jobs = Jobs()
        self._process: SpawnProcess | None = None
        self._pipe: Connection | None = None
        self._told: list[Event] = []
        if warm:
            self._start()

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
        return self._process is not None

    def ask(self, job: Job) -> None:
        """Do a job when those before it are done; `poll` says how it went."""
        self._told += self._do(job_state.asked(self.jobs, job))

    def cancel(self) -> list[Event]:
        """End what is being done, and forget what waits."""
        return self._do(job_state.cancelled(self.jobs))

    def rest(self) -> None:
        """End the process if nothing is being done; the next job starts another one."""
        if self.jobs.state is State.IDLE and self.alive:
            self._kill()
            self._do(job_state.died(self.jobs))

    def poll(self) -> list[Event]:
        """Return what has happened since the last call."""
        events, self._told = self._told, []
        while self._ready():
            try:
                kind, value = self._receive()
            except (EOFError, OSError):
                return [*events, *self._do(job_state.died(self.jobs))]
            if kind == 'progress':
                events.append(Progressed(*value))
            elif kind == 'done':
                events += self._do(job_state.answered(self.jobs, value))
            else:
                events += self._do(job_state.answered(self.jobs, None, value))
        return events

    def close(self) -> None:
        """End the process."""
        self._do(job_state.closed(self.jobs))

    def _do(self, move: Move) -> list[Event]:
        self.jobs = move.jobs
        if move.end:
            self._kill()
        if move.send is not None:
            self._send(move.send)
        return list(move.events)

    def _send(self, job: Job) -> None:
        if self._pipe is None:
            self._start()
        try:
            if self._pipe is not None:
                self._pipe.send(job)
        except (BrokenPipeError, OSError):
            # `poll` finds the process gone.
            pass

    def _receive(self) -> tuple[str, Any]:
        if self._pipe is None:
            raise EOFError
        kind, value = self._pipe.recv()
        return kind, value

    def _ready(self) -> bool:
        try:
            return self._pipe is not None and self._pipe.poll()
        except (BrokenPipeError, OSError):
            return True

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
