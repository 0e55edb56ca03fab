"""The node's end of the fit process: kept warm, watched, and replaced when it dies or hangs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
import os
import subprocess
import sys
from threading import Thread

from gravity_comp_ros.node.fit_messages import Findings, Job, Look, Outcome, Question, Seen

STARTING = 'starting'
READY = 'ready'
BUSY = 'fitting'
DOWN = 'down'

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

    def __init__(self, timeout: float, command: Sequence[str] = (
            sys.executable, '-m', 'gravity_comp_ros.node.fit_worker')) -> None:
        self.timeout = timeout
        self.restarts = 0
        self.last_failure = ''
        self.state = DOWN
        self._command = tuple(command)
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None
        self._job: AnyJob | None = None
        self._since = 0.0
        self._delay = FIRST_DELAY
        self._start_at = 0.0

    @property
    def pid(self) -> int | None:
        """The process id, None while there is no process."""
        return self._process.pid if self._process else None

    @property
    def job(self) -> AnyJob | None:
        """The job that runs, if any."""
        return self._job

    def seconds(self, now: float) -> float:
        """Return for how long the present state has lasted."""
        return now - self._since

    def start(self, now: float) -> None:
        """Start the process; it says by itself when it is ready."""
        ours, theirs = Pipe()
        # A process started with sys.path changed must find the same package.
        environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(p for p in sys.path if p),
                       'OPENBLAS_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}
        try:
            with _plain_children():
                self._process = subprocess.Popen(
                    [*self._command, str(theirs.fileno())], pass_fds=[theirs.fileno()],
                    stdin=subprocess.DEVNULL, env=environment, start_new_session=True)
        except OSError as problem:
            ours.close()
            self._fail(f'the fit process cannot be started: {problem}', now)
            return
        finally:
            theirs.close()
        self._connection, self.state, self._since = ours, STARTING, now

    def submit(self, job: AnyJob, now: float) -> bool:
        """Give the process a job; False if it is not ready for one."""
        if self.state != READY or self._connection is None:
            return False
        self._job, self.state, self._since = job, BUSY, now
        # A pipe that nobody empties blocks its writer, and this process must not wait.
        Thread(target=_send, args=(self._connection, job), daemon=True).start()
        return True

    def poll(self, now: float) -> list[Event]:
        """Return what happened since the last call; restarts a process that was lost."""
        if self.state == DOWN:
            if now >= self._start_at:
                self.start(now)
            return []
        events: list[Event] = []
        try:
            while self._connection is not None and self._connection.poll():
                self._take(self._connection.recv(), events, now)
        except (EOFError, OSError):
            return [*events, self._lose(f'the fit process died ({self._exit_text()})', now)]
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
        self._end()
        self._job = None
        self._start_at = float('inf')

    def _take(self, message: tuple, events: list[Event],
              now: float) -> None:
        kind = message[0]
        if kind == 'ready':
            self._delay = FIRST_DELAY
        elif kind == 'done':
            events.append(message[1])
        else:
            self.last_failure = message[2]
            events.append(Failure(message[2], message[1], lost=False))
        self._job, self.state, self._since = None, READY, now

    def _lose(self, reason: str, now: float) -> Failure:
        number = self._job.number if self._job else None
        self._end()
        self._fail(reason, now)
        return Failure(reason, number, lost=True)

    def _fail(self, reason: str, now: float) -> None:
        self.restarts += 1
        self.last_failure = reason
        self._job, self.state, self._since = None, DOWN, now
        # One that dies as it starts is not to be started a hundred times a second.
        self._start_at = now + self._delay
        self._delay = min(2 * self._delay, LONGEST_DELAY)

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            try:
                self._process.wait(timeout=0.5)
            except subprocess.TimeoutExpired:
                # Killed all the same; a process stuck in the kernel must not hold this one up.
                pass
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = None
        self.state = DOWN

    def _exit_text(self) -> str:
        code = None
        if self._process is not None:
            try:
                code = self._process.wait(timeout=0.2)
            except subprocess.TimeoutExpired:
                return 'it closed its pipe'
        return f'signal {-code}' if code is not None and code < 0 else f'exit code {code}'


@contextmanager
def _plain_children() -> Iterator[None]:
    """Let a child have the priority of any process, where this one has that of control."""
    if not hasattr(os, 'SCHED_RESET_ON_FORK'):
        yield
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, parameters)
    try:
        yield
    finally:
        # Only the privileged may take it back; for others it stays, which does no harm.
        with suppress(PermissionError):
            os.sched_setscheduler(0, policy, parameters)


def _send(connection: Connection, job: AnyJob) -> None:
    try:
        connection.send(job)
    except (OSError, ValueError):
        # The other end is gone, which `poll` will see; or this end was closed meanwhile.
        pass
