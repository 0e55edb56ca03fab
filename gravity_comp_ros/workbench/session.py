"""
Sessions of one server: recordings, settings, stages of the model, running job and messages.

Requests of the page and events of the worker change the state; `results` computes what the page
shows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
import secrets
from tempfile import TemporaryDirectory
import time
from typing import Any

from gravity_comp_ros.api.model import Model
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import Learned, with_enough_motion
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import DataError, GravityCompError
from gravity_comp_ros.estimation.refit import Refit
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.expected import MotionPlan
from gravity_comp_ros.recordings.read_options import BY_JOINT
from gravity_comp_ros.workbench import store
from gravity_comp_ros.workbench.jobs import Answer, Job, new_worker, ReadResult, Step
from gravity_comp_ros.workbench.store import Choice, Stage, State
from gravity_comp_ros.worker.worker_process import Failed, Progress, Worker


class Session(State):
    """
    A session with its worker. `version` increases with every change to show.

    A new stage replaces those after the current one. `error` is the reason why the work stopped;
    `try_again` continues it. `warning` is about the recordings or the last request, `save_error`
    is the reason why the session is not saved. `seen` is the time at which a browser asked for it
    last, and `page` belongs to the server.

    :param place: folder of saved sessions; None to save none.
    """

    def __init__(self, state: State, worker: Worker, identity: str = '',
                 place: Path | None = None) -> None:
        super().__init__(**vars(state))
        self.id, self.place, self.worker = identity, place, worker
        self.ordered = bool(self.choice.joints)
        if not self.stages:
            self.joints, self.to_learn = self.choice.joints, not self.given
        self.read: ReadResult | None = None
        self._read_key: tuple[object, ...] = ()
        self.ungated = ''
        self.error = self.done = self.warning = self.save_error = ''
        self.progress: Progress | None = None
        self.version = 0
        self.seen = time.monotonic()
        self.page: Any = None
        self._plan: tuple[Job, MotionPlan] | None = None

    @property
    def stage(self) -> Stage | None:
        """Return the current stage."""
        return None if self.at is None else self.stages[self.at]

    @property
    def diagnosis(self) -> Diagnosis | None:
        """Return the diagnosis of the current model with the current choice."""
        stage = self.stage
        return stage.diagnosis if stage and stage.diagnosed_with == self.choice else None

    @property
    def is_read(self) -> bool:
        """Return whether the recordings have been read with the current choice."""
        return self._read_key == self._job(Step.READ).samples_key

    @property
    def plan(self) -> MotionPlan | None:
        """Return the motion planned for the current model and choice."""
        if self._plan is None or self.stage is None:
            return None
        job, plan = self._plan
        return plan if job.choice == self.choice and job.model is self.stage.model else None

    # Requests of the page.

    def start(self) -> None:
        """Start the next job if no job is running."""
        job = None if self.worker.job or self.error else self.next_job()
        if job is not None:
            self.worker.start(job)

    def next_job(self) -> Job | None:
        """Return the next job: read the recordings, fit a model, or diagnose it."""
        if self.given and not self.stages:
            self.choice = replace(self.choice, joints=self.given[0].model.joints)
        if not self.is_read:
            return self._job(Step.READ)
        if self.choice.runs and self.to_learn:
            return self._job(Step.LEARN)
        if self.choice.runs and self.stage is not None and self.diagnosis is None:
            return self._job(Step.DIAGNOSE, self.stage.model)
        return None

    def try_again(self) -> None:
        """Continue after an error."""
        with self._changing():
            pass

    def cancel(self) -> None:
        """Cancel the running job."""
        job = self.worker.job
        if job is not None:
            self._interrupt()
            self.error = f'{job} was cancelled'
            self.version += 1

    def learn(self, choice: Choice) -> None:
        """Fit a new model."""
        with self._changing():
            self.choice, self.to_learn, self.warning = choice, True, ''

    def evaluate(self, choice: Choice) -> None:
        """Evaluate the current model on other samples."""
        with self._changing():
            model = self._current().model
            if model.joints != choice.joints:
                raise DataError(f'the joints of the model are {", ".join(model.joints)}: fit a '
                                f'model of the selected joints, or select those')
            self.choice = replace(choice, formulation=self.choice.formulation)

    def add(self, effects: tuple[str, ...]) -> None:
        """Add effects, in the notation of `gravity_comp add`, to the current model."""
        self._submit(Step.ADD, effects)

    def request_plan(self, effects: tuple[str, ...] | None) -> None:
        """Plan a motion that resolves these effects, or all open findings (None)."""
        self._submit(Step.PLAN, effects)

    def select_stage(self, number: int) -> None:
        """Undo, or redo, up to a stage."""
        if not 0 <= number < len(self.stages) or number == self.at:
            return
        with self._changing():
            stage = self.stages[number]
            self.at, self.to_learn, self.choice = number, False, stage.choice
            self.done = f'back at {number + 1}. {stage.name}'

    def warn(self, reason: str) -> None:
        """Show a warning about the last request."""
        self.warning = reason
        self.version += 1

    def add_recording(self, path: Path) -> None:
        """Add a recording, which is read next."""
        with self._changing():
            self.paths = (*self.paths, path)

    # Events of the worker.

    def poll(self) -> None:
        """Process the events of the worker since the last call."""
        for job, message in self.worker.poll():
            self.progress = message if isinstance(message, Progress) else None
            if isinstance(message, Progress):
                continue
            self.version += 1
            try:
                if isinstance(message, Failed):
                    self._failed(job, message.reason)
                else:
                    self._finished(job, message.answer)
            except GravityCompError as problem:
                self.error = str(problem)
            self.start()

    def _failed(self, job: Job, reason: str) -> None:
        self.error = reason
        n_read = len(self.read.reports) if self.read else len(self.paths)
        if job.step is Step.READ and len(self.paths) > n_read:
            # Continue without the new recording. The message omits its internal folder.
            new = self.paths[-1]
            self.warning = f'not added: {self.error}'.replace(f'{new.parent}/', '')
            self.paths, self.error = self.paths[:n_read], ''
            new.unlink(missing_ok=True)

    def _finished(self, job: Job, answer: Answer) -> None:
        if isinstance(answer, MotionPlan):
            self._plan = job, answer
        elif isinstance(answer, Diagnosis) and self.at is not None:
            self.stages = tuple(
                replace(stage, diagnosis=answer, diagnosed_with=job.choice)
                if number == self.at else stage for number, stage in enumerate(self.stages))
        elif isinstance(answer, ReadResult):
            self._accept_recordings(answer)
        elif isinstance(answer, Learned):
            self._learned(job, answer)
        elif isinstance(answer, Refit):
            names = answer.added
            name = ', '.join(names) if len(names) < 3 else f'{names[0]} and {len(names) - 1} more'
            self._append(Stage(f'+ {name}', answer.model, job.choice, answer.added, warnings=(
                *answer.warnings(), *Model(answer.model).warnings)))
        if job.step in (Step.READ, Step.LEARN, Step.ADD):
            self._save()

    def _accept_recordings(self, read: ReadResult) -> None:
        """Set the recordings; new ones are selected."""
        names, n_runs = read.samples.names, read.samples.n_runs
        is_first = self.read is None and not self.stages
        n_before = len(self.read.reports) if self.read else n_runs
        runs = (*self.choice.runs, *range(n_before, n_runs)) if self.choice.runs else tuple(
            range(n_runs))
        # From here on, joints are named.
        options = read.reports[0].options
        by_joint = {name: getattr(options, name) for name in BY_JOINT}
        self.choice = replace(self.choice, joints=options.joints or names, runs=runs,
                              reading=replace(self.choice.reading, **by_joint))
        if not set(self.joints) >= set(self.choice.joints):
            self.joints = (*names, *read.left_out)
        self.read = read
        self._read_key = self._job(Step.READ).of_joints(names).samples_key
        hashes = {str(path.resolve()): report.sha256
                  for path, report in zip(self.paths, read.reports)}
        changed = [Path(path).name for path, old in self.hashes.items()
                   if hashes.get(path, old) != old]
        self.hashes = hashes
        if changed:
            self.warning = (f'{", ".join(changed)} changed since this session was saved: its '
                            f'models were fitted to the previous content')
        if is_first and self.given:
            first = self.given[0]
            self._append(replace(first, choice=self.choice,
                                 warnings=Model(first.model).warnings))
        elif is_first:
            # All samples of a fast recording, as `fit` does.
            recording = Recording(read.samples, self.choice.gate, read.reports)
            self.ungated = with_enough_motion(recording).ungated
            if self.ungated:
                self.choice = replace(self.choice, gate=None)

    def _learned(self, job: Job, answer: Learned) -> None:
        """Append a fitted model; its joints are in the order of the arm."""
        joints = answer.model.joints
        self.choice, self.to_learn = replace(job.choice, joints=joints), False
        self.joints = (*joints, *(name for name in self.joints if name not in joints))
        left_out = answer.arm.left_out
        warnings = [*answer.result.report.warnings]
        if left_out:
            warnings.append(f'Omitted, because not part of the arm: {", ".join(left_out)}.')
        self._append(Stage('gravity', answer.model, self.choice, warnings=tuple(warnings)))

    def _job(self, step: Step, model: GravityModel | None = None,
             effects: tuple[str, ...] | None = None) -> Job:
        return Job(step, self.paths, self.choice, self.ordered,
                   self.given[0].name if self.given else '', model, effects, self.diagnosis)

    def _append(self, stage: Stage) -> None:
        self.stages = (*self.stages[:0 if self.at is None else self.at + 1], stage)
        self.at = len(self.stages) - 1

    def _current(self) -> Stage:
        if self.stage is None:
            raise DataError('there is no model yet: fit one')
        return self.stage

    def _submit(self, step: Step, effects: tuple[str, ...] | None) -> None:
        with self._changing():
            model = self._current().model
            self.worker.start(self._job(step, model, effects))

    @contextmanager
    def _changing(self) -> Iterator[None]:
        """Interrupt the running job; after the change, save the session and go on."""
        self._interrupt()
        try:
            yield
        except GravityCompError as problem:
            self.error = str(problem)
        else:
            self._save()
            self.start()
        self.version += 1

    def _interrupt(self) -> None:
        # The running job concerns the state before the change; its result is not required.
        self.worker.cancel()
        self.error, self.done, self.progress = '', '', None

    def _save(self) -> None:
        if self.place is None or not self.stages:
            return
        try:
            store.save(self.place, self.id, self)
            self.save_error = ''
        except GravityCompError as problem:
            self.save_error = str(problem)


# Time, in s, after which a session that no browser shows is closed; it remains saved.
UNUSED = 60.0


class Sessions:
    """
    The open sessions.

    :param start: initial state of a new session.
    :param place: folder of saved sessions; None to save none.
    """

    def __init__(self, start: State, place: Path | None,
                 new_worker: Callable[[], Worker] = new_worker) -> None:
        self._start, self.place, self._new_worker = start, place, new_worker
        self.open: dict[str, Session] = {}
        self._temporary: TemporaryDirectory[str] | None = None

    def session(self, identity: str) -> Session:
        """Return the session with this id, or a new one if there is none."""
        session = self.open.get(identity) or self._opened(identity)
        session.seen = time.monotonic()
        self.open[session.id] = session
        return session

    def upload_folder(self, identity: str) -> Path:
        """Return the folder of the uploaded recordings of a session."""
        if self.place is not None:
            return self.place / 'recordings' / identity
        if self._temporary is None:
            self._temporary = TemporaryDirectory(prefix='gravity_comp')
        return Path(self._temporary.name) / identity

    def poll(self) -> None:
        """Process the events of all workers; close the sessions that no browser shows."""
        for session in list(self.open.values()):
            session.poll()
            is_saved = session.read is None or (
                self.place is not None and bool(session.stages) and not session.save_error)
            if session.worker.job is None and time.monotonic() - session.seen > UNUSED:
                session.worker.rest()
                if is_saved:
                    del self.open[session.id]

    def earlier(self, own: str = '') -> list[store.Entry]:
        """Return the saved sessions, the newest first."""
        if self.place is None:
            return []
        return [entry for entry in store.listed(self.place) if entry.id != own]

    def close(self) -> None:
        """End all workers."""
        for session in self.open.values():
            session.worker.rest()
        if self._temporary is not None:
            self._temporary.cleanup()

    def _opened(self, identity: str) -> Session:
        """Return the saved session with this id, or a new one."""
        warning = ''
        if identity and self.place is not None:
            try:
                return Session(store.load(self.place, identity), self._new_worker(), identity,
                               self.place)
            except GravityCompError as problem:
                warning = str(problem)
        session = Session(self._start, self._new_worker(), secrets.token_hex(8), self.place)
        session.warning = warning
        return session
