"""One session with the process that works for it; pages come and go, it stays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import time

from gravity_comp_ros.api.learn import Learned
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.estimation.refit_result import Refit
from gravity_comp_ros.planning.plan import Plan
from gravity_comp_ros.workbench import store
from gravity_comp_ros.workbench.choice import Choice
from gravity_comp_ros.workbench.job_state import Event, Failed, Finished
from gravity_comp_ros.workbench.jobs import (
    Add, Diagnose, described, Job, Learn, PlanMotion, Read, ReadResult)
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.worker import Worker
from gravity_comp_ros.worker.messages import Progress

BUSY = 'every process that may work at a time is busy with another session: wait, or cancel there'


class OpenSession:
    """
    A session at work. `version` rises whenever there is something new to show.

    `trouble` says why the work stopped; it goes on when the user says so (`try_again`).
    `warning` is about what was read or asked for, `unsaved` why the session cannot be kept on
    disk; what is doubtful of a model stands with its stage.
    """

    def __init__(self, identity: str, session: Session, place: Path | None,
                 may_start: Callable[[OpenSession], bool], worker: Worker | None = None) -> None:
        self.id, self.session, self.place = identity, session, place
        self.worker = worker or Worker()
        self.trouble, self.done, self.warning = '', '', ''
        self._refused = self.unsaved = ''
        self.progress: Progress | None = None
        self.version = 0
        self.page: object | None = None
        self.left = time.monotonic()
        self.hashes: dict[str, str] = {}
        self._may_start = may_start

    @property
    def is_adding(self) -> bool:
        """Return whether effects are being added."""
        return isinstance(self.worker.running, Add)

    # What a page asks for.

    def start(self) -> None:
        """Do what is needed next, if nothing is being done."""
        job = None if self.worker.busy or self.trouble else self.session.next_job()
        if job is not None:
            self._ask(job)

    def try_again(self) -> None:
        """Go on after trouble."""
        self.trouble = ''
        self.start()
        self._news()

    def cancel(self) -> None:
        """End what is being done."""
        for event in self.worker.cancel():
            self._heard(event)
        self._news()

    def learn(self, choice: Choice) -> None:
        """Learn a model anew."""
        self._interrupt()
        self.session.learn(choice)
        self._go_on()

    def bring(self, path: Path) -> None:
        """Put one more recording on the bench."""
        self._interrupt()
        self.session.bring(path)
        self.start()
        self._news()

    def judge(self, choice: Choice) -> None:
        """Judge the present model on something else."""
        self._try(lambda: self.session.judge(choice))

    def add(self, effects: tuple[str, ...]) -> None:
        """Add effects to the present model."""
        self._work(lambda: self.session.adding(effects))

    def plan(self, effects: tuple[str, ...] | None) -> None:
        """Plan the recording that settles these effects, or all that is open."""
        self._work(lambda: self.session.planning(effects))

    def undo(self) -> None:
        """Go back to before the last addition."""
        self._try(self._undo)

    def go_to(self, number: int) -> None:
        """Go to a stage."""
        if 0 <= number < len(self.session.stages) and number != self.session.at:
            self._try(lambda: self.session.go_to(number))

    def describe(self, name: str, note: str) -> None:
        """Name the present stage, and keep a note with it."""
        if self.session.at is not None:
            self.session.describe(self.session.at, name, note)
            self._save()
            self._news()

    # What comes back.

    def poll(self) -> None:
        """Take what the process has done since the last call."""
        events = self.worker.poll()
        for event in events:
            self._heard(event)
        if events:
            self.start()

    def close(self) -> None:
        """End the work."""
        self.worker.close()

    def _undo(self) -> None:
        self.done = f'{self.session.undo()} taken back'

    def _try(self, action: Callable[[], None]) -> None:
        self._interrupt()
        try:
            action()
        except GravityCompError as problem:
            self.trouble = str(problem)
            self._news()
            return
        self._go_on()

    def _work(self, job: Callable[[], Job]) -> None:
        self._interrupt()
        try:
            self._ask(job())
        except GravityCompError as problem:
            self.trouble = str(problem)
        self._news()

    def _interrupt(self) -> None:
        # Whatever is being done is about what is going to change; nobody waits for it.
        if self.worker.busy:
            self.worker.cancel()
        self.trouble = self.done = ''

    def _go_on(self) -> None:
        self._save()
        self.start()
        self._news()

    def _ask(self, job: Job) -> None:
        if not self.worker.alive and not self._may_start(self):
            self.trouble = BUSY
            return
        self.worker.ask(job)
        self.progress = None

    def _heard(self, event: Event) -> None:
        if isinstance(event, Progress):
            self.progress = event
            return
        self.progress = None
        if isinstance(event, Failed):
            self.trouble = f'{described(event.job)} was cancelled' if event.cancelled else \
                event.reason
            brought = self.session.give_back() if isinstance(event.job, Read) else ()
            for path in brought:
                # The work goes on without it. Its folder is ours, and says nothing to the user.
                self.trouble = self.trouble.replace(f'{path.parent}/', '')
                path.unlink(missing_ok=True)
            if brought:
                self._refused, self.trouble = f'not taken: {self.trouble}', ''
        elif isinstance(event, Finished):
            self._finished(event)
        self._news()

    def _finished(self, event: Finished) -> None:
        job, answer, session = event.job, event.answer, self.session
        self.trouble = ''
        if isinstance(job, (Read, Learn)):
            self.warning = ''
        try:
            if isinstance(job, Read) and isinstance(answer, ReadResult):
                session.take(answer, job.options)
                self.warning, self._refused = self._refused, ''
                self._save()
                changed = store.changed_recordings(session, self.hashes)
                if changed:
                    self.warning = (f'{", ".join(changed)} changed since this session was kept: '
                                    f'its models were learned from what was there before')
            elif isinstance(job, Learn) and isinstance(answer, Learned):
                session.learned(answer, job.choice)
            elif isinstance(job, Add) and isinstance(answer, Refit):
                session.added(answer, job)
            elif isinstance(job, Diagnose) and isinstance(answer, Diagnosis):
                session.diagnosed(answer, job)
            elif isinstance(job, PlanMotion) and isinstance(answer, Plan):
                session.planned(answer, job)
        except GravityCompError as problem:
            self.trouble = str(problem)
            return
        if not isinstance(job, (Read, Diagnose, PlanMotion)):
            self._save()

    def _save(self) -> None:
        if self.place is None or not self.session.stages:
            return
        try:
            store.save(self.place, self.id, self.session)
            self.unsaved = ''
        except GravityCompError as problem:
            self.unsaved = str(problem)

    def _news(self) -> None:
        self.version += 1
