"""One session with its worker process; it persists when its page is closed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import time

from gravity_comp_ros.api.learn import Learned
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.estimation.refit import Refit
from gravity_comp_ros.planning.plan import Plan
from gravity_comp_ros.workbench import store
from gravity_comp_ros.workbench.choice import Choice
from gravity_comp_ros.workbench.job_state import Event, Failed, Finished
from gravity_comp_ros.workbench.jobs import (
    Add, described, Diagnose, Job, Learn, PlanMotion, Read, ReadResult)
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.worker import Worker
from gravity_comp_ros.worker.messages import Progress

BUSY = 'all worker processes are busy with another session: wait, or cancel there'


class OpenSession:
    """
    A session with its worker. `version` increases with every change to show.

    `error` is the reason why the work stopped; `try_again` continues it. `warning` is about the
    recordings or the last request, `save_error` is the reason why the session is not saved.
    Warnings about a model belong to its stage.
    """

    def __init__(self, identity: str, session: Session, place: Path | None,
                 may_start: Callable[[OpenSession], bool], worker: Worker | None = None) -> None:
        self.id, self.session, self.place = identity, session, place
        self.worker = worker or Worker()
        self.error, self.done, self.warning = '', '', ''
        self._upload_error = self.save_error = ''
        self.progress: Progress | None = None
        self.version = 0
        self.page: object | None = None
        self.detached_at = time.monotonic()
        self.hashes: dict[str, str] = {}
        self._may_start = may_start

    @property
    def is_adding(self) -> bool:
        """Return whether effects are being added."""
        return isinstance(self.worker.running, Add)

    # Requests of a page.

    def start(self) -> None:
        """Start the next job if no job is running."""
        job = None if self.worker.busy or self.error else self.session.next_job()
        if job is not None:
            self._start_job(job)

    def try_again(self) -> None:
        """Continue after an error."""
        self.error = ''
        self.start()
        self._changed()

    def cancel(self) -> None:
        """Cancel the running job."""
        for event in self.worker.cancel():
            self._on_event(event)
        self._changed()

    def learn(self, choice: Choice) -> None:
        """Fit a new model."""
        self._interrupt()
        self.session.learn(choice)
        self._continue()

    def add_recording(self, path: Path) -> None:
        """Add a recording to the session."""
        self._interrupt()
        self.session.add_recording(path)
        self.start()
        self._changed()

    def evaluate(self, choice: Choice) -> None:
        """Evaluate the current model on other samples."""
        self._try(lambda: self.session.evaluate(choice))

    def add(self, effects: tuple[str, ...]) -> None:
        """Add effects to the current model."""
        self._submit(lambda: self.session.adding(effects))

    def plan(self, effects: tuple[str, ...] | None) -> None:
        """Plan a motion that resolves these effects, or all open findings."""
        self._submit(lambda: self.session.planning(effects))

    def undo(self) -> None:
        """Undo the last addition."""
        self._try(self._undo)

    def select_stage(self, number: int) -> None:
        """Make a stage the current one."""
        if 0 <= number < len(self.session.stages) and number != self.session.at:
            self._try(lambda: self.session.select_stage(number))

    def describe(self, name: str, note: str) -> None:
        """Set name and note of the current stage."""
        if self.session.at is not None:
            self.session.describe(self.session.at, name, note)
            self._save()
            self._changed()

    # Results of the worker.

    def poll(self) -> None:
        """Process the events of the worker since the last call."""
        events = self.worker.poll()
        for event in events:
            self._on_event(event)
        if events:
            self.start()

    def close(self) -> None:
        """Close the worker."""
        self.worker.close()

    def _undo(self) -> None:
        self.done = f'{self.session.undo()} removed'

    def _try(self, action: Callable[[], None]) -> None:
        self._interrupt()
        try:
            action()
        except GravityCompError as problem:
            self.error = str(problem)
            self._changed()
            return
        self._continue()

    def _submit(self, job: Callable[[], Job]) -> None:
        self._interrupt()
        try:
            self._start_job(job())
        except GravityCompError as problem:
            self.error = str(problem)
        self._changed()

    def _interrupt(self) -> None:
        # The running job concerns the state before the change; its result is not required.
        if self.worker.busy:
            self.worker.cancel()
        self.error = self.done = ''

    def _continue(self) -> None:
        self._save()
        self.start()
        self._changed()

    def _start_job(self, job: Job) -> None:
        if not self.worker.alive and not self._may_start(self):
            self.error = BUSY
            return
        self.worker.ask(job)
        self.progress = None

    def _on_event(self, event: Event) -> None:
        if isinstance(event, Progress):
            self.progress = event
            return
        self.progress = None
        if isinstance(event, Failed):
            self.error = f'{described(event.job)} was cancelled' if event.cancelled else \
                event.reason
            unread = self.session.remove_unread() if isinstance(event.job, Read) else ()
            for path in unread:
                # Continue without it. The message omits the internal folder.
                self.error = self.error.replace(f'{path.parent}/', '')
                path.unlink(missing_ok=True)
            if unread:
                self._upload_error, self.error = f'not added: {self.error}', ''
        elif isinstance(event, Finished):
            self._finished(event)
        self._changed()

    def _finished(self, event: Finished) -> None:
        job, answer, session = event.job, event.answer, self.session
        self.error = ''
        if isinstance(job, (Read, Learn)):
            self.warning = ''
        try:
            if isinstance(job, Read) and isinstance(answer, ReadResult):
                session.accept_recordings(answer, job.options)
                self.warning, self._upload_error = self._upload_error, ''
                self._save()
                changed = store.changed_recordings(session, self.hashes)
                if changed:
                    self.warning = (f'{", ".join(changed)} changed since this session was saved: '
                                    f'its models were fitted to the previous content')
            elif isinstance(job, Learn) and isinstance(answer, Learned):
                session.learned(answer, job.choice)
            elif isinstance(job, Add) and isinstance(answer, Refit):
                session.added(answer, job)
            elif isinstance(job, Diagnose) and isinstance(answer, Diagnosis):
                session.diagnosed(answer, job)
            elif isinstance(job, PlanMotion) and isinstance(answer, Plan):
                session.planned(answer, job)
        except GravityCompError as problem:
            self.error = str(problem)
            return
        if not isinstance(job, (Read, Diagnose, PlanMotion)):
            self._save()

    def _save(self) -> None:
        if self.place is None or not self.session.stages:
            return
        try:
            store.save(self.place, self.id, self.session)
            self.save_error = ''
        except GravityCompError as problem:
            self.save_error = str(problem)

    def _changed(self) -> None:
        self.version += 1
