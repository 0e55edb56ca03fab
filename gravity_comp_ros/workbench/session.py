"""
State of the workbench: recordings, settings, stages of the model, running job and messages.

Requests of the page and events of the worker change it; `results` computes what the page shows.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from gravity_comp_ros.api.model import Model
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import Learned, with_enough_motion
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import DataError, GravityCompError
from gravity_comp_ros.estimation.refit import Refit
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.expected import MotionPlan
from gravity_comp_ros.recordings.read_options import BY_JOINT
from gravity_comp_ros.workbench.jobs import Answer, Job, ReadResult, Step
from gravity_comp_ros.workbench.stages import Choice, MODEL_FILE, Stage
from gravity_comp_ros.worker.worker_process import Failed, Progress, Worker


class Session:
    """
    The state of the workbench, with its worker. `version` increases with every change to show.

    `given` are model files named on the command line. `joints` are all that can be chosen.
    `stages` are in the order of their creation, and `at` is the number of the current one; a new
    one replaces those after it. `to_learn` tells whether a fit was requested. `error` is the
    reason why the work stopped; `try_again` continues it. `warning` is about the recordings or the
    last request.
    """

    def __init__(self, paths: tuple[Path, ...], choice: Choice, given: tuple[Stage, ...],
                 worker: Worker) -> None:
        self.paths, self.choice, self.given, self.worker = paths, choice, given, worker
        self.ordered = bool(choice.joints)
        self.joints, self.to_learn = choice.joints, not given
        self.stages: tuple[Stage, ...] = ()
        self.at: int | None = None
        self.read: ReadResult | None = None
        self._read_key: tuple[object, ...] = ()
        self.ungated = self.error = self.done = self.warning = ''
        self.progress: Progress | None = None
        self.version = 0
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

    def commands(self) -> list[str]:
        """Return command lines that reproduce the current model exactly, and its evaluation."""
        if self.at is None:
            return []
        # From the last fit or file up to the current stage.
        start = max(k for k in range(self.at + 1) if not self.stages[k].effects)
        choice, model = self.choice, MODEL_FILE
        return [*(stage.command(self.paths) for stage in self.stages[start:self.at + 1]),
                choice.command('compare', self.paths, model=model),
                choice.command('diagnose', self.paths, gated=False, model=model,
                               html='report.html')]

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
        """
        Add a recording, which is read next.

        :raises DataError: if the first recordings have not been read.
        """
        if self.read is None:
            raise DataError('wait until the recordings have been read')
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
            # Continue without the new recording.
            self.warning, self.error = f'not added: {reason}', ''
            self.paths = self.paths[:n_read]

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
        """Interrupt the running job; go on after the change."""
        self._interrupt()
        try:
            yield
        except GravityCompError as problem:
            self.error = str(problem)
        else:
            self.start()
        self.version += 1

    def _interrupt(self) -> None:
        # The running job concerns the state before the change; its result is not required.
        self.worker.cancel()
        self.error, self.done, self.progress = '', '', None
