"""
State of a session: recordings, settings, stages of the model, and diagnoses.

Does not depend on Bokeh or on processes: `next_job` returns the next job, and one method per
answer updates the state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from gravity_comp_ros.api.learn import Learned
from gravity_comp_ros.api.model import report_of
from gravity_comp_ros.api.provenance import now
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import with_enough_motion
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.estimation.refit import Refit
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.history import undone
from gravity_comp_ros.planning.plan import Plan
from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.workbench.choice import Choice
from gravity_comp_ros.workbench.jobs import Add, Diagnose, Learn, PlanMotion, Read, ReadResult
from gravity_comp_ros.workbench.stages import Stage, warnings_of_fit

Value = TypeVar('Value')
# Maximum number of added effects in the name of a stage.
_MAX_NAMED = 2


@dataclass(frozen=True)
class GivenModel:
    """A model file named on the command line."""

    path: Path
    model: GravityModel

    @property
    def name(self) -> str:
        """Return the name on the page."""
        return self.path.name


class CacheKey:
    """Key of a cached value: an equal choice and identical objects."""

    def __init__(self, choice: Choice, *things: object) -> None:
        self._choice, self._things = choice, things

    def __eq__(self, other: object) -> bool:
        return (isinstance(other, CacheKey) and self._choice == other._choice
                and len(self._things) == len(other._things)
                and all(a is b for a, b in zip(self._things, other._things)))


class SessionState:
    """Recordings, settings and stages of one user's session."""

    def __init__(self, paths: tuple[Path, ...], choice: Choice = Choice(),
                 given: tuple[GivenModel, ...] = (), topic: str | None = None,
                 urdf: Path | None = None) -> None:
        self.paths, self.choice, self.given, self.topic = paths, choice, given, topic
        self.urdf = urdf
        self.read: ReadResult | None = None
        self.read_with: ReadOptions | None = None
        self.joints: tuple[str, ...] = choice.joints
        self.stages: list[Stage] = []
        self.at: int | None = None
        self.to_learn = not given
        self._ordered = bool(choice.joints)
        self.ungated = ''
        self._cache: dict[str, tuple[object, Any]] = {}
        self._plan: tuple[PlanMotion, Plan] | None = None

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
    def recording(self) -> Recording:
        """
        Return the chosen runs and joints.

        :raises DataError: if no recording was read or selected.
        """
        if self.read is None:
            raise DataError('no recording has been read')
        samples, reports = self.read.samples, self.read.reports
        return self.cached('recording', CacheKey(self.choice, self.read),
                           lambda: self.choice.recording(samples, reports))

    def cached(self, name: str, key: object, make: Callable[[], Value]) -> Value:
        """Return the cached value of this name and key, computed if there is none."""
        entry = self._cache.get(name)
        if entry is None or entry[0] != key:
            entry = self._cache[name] = (key, make())
        value: Value = entry[1]
        return value

    # Jobs.

    def next_job(self) -> Read | Learn | Diagnose | None:
        """Return the next job: read the recordings, fit a model, or diagnose it."""
        if not self.paths:
            return None
        model = self.given[0] if self.given else None
        if self.read is None and model is not None and not self.choice.joints:
            self.choice = replace(self.choice, joints=model.model.joints)
        options = self.choice.reading(self.topic)
        if self.read is None or not _same(options, self.read_with) \
                or len(self.read.reports) != len(self.paths):
            return Read(self.paths, options, model.name if model else '', self.choice.urdf)
        if not self.choice.runs:
            return None
        if self.to_learn:
            return Learn(self.choice, self._ordered)
        if self.stage is not None and self.diagnosis is None:
            return Diagnose(self.choice, self.stage.model)
        return None

    def adding(self, effects: tuple[str, ...]) -> Add:
        """
        Return the job that adds effects to the current model.

        :raises DataError: if there is no model yet.
        """
        if self.stage is None:
            raise DataError('there is no model yet')
        return Add(self.choice, self.stage.model, effects)

    def planning(self, effects: tuple[str, ...] | None) -> PlanMotion:
        """
        Return the job that plans the next recording.

        :param effects: effects to resolve; None for all open findings of the diagnosis.
        :raises DataError: if there is no model or no diagnosis yet.
        """
        if self.stage is None or self.diagnosis is None:
            raise DataError('there is no diagnosis yet')
        return PlanMotion(self.choice, self.stage.model, self.diagnosis, effects)

    def learn(self, choice: Choice) -> None:
        """Set the choice for a new fit. Earlier stages are kept."""
        self.choice, self.to_learn = choice, True

    def evaluate(self, choice: Choice) -> None:
        """
        Set the choice for the evaluation of the current model.

        :raises DataError: if there is no model, or it has other joints.
        """
        if self.stage is None:
            raise DataError('there is no model yet: fit one')
        if self.stage.model.joints != choice.joints:
            raise DataError(f'the joints of the model are {", ".join(self.stage.model.joints)}: '
                            f'fit a model of the selected joints, or select those')
        self.choice = replace(choice, formulation=self.choice.formulation)

    def add_recording(self, path: Path) -> None:
        """Add a recording, to be read next."""
        self.paths = (*self.paths, path)

    def remove_unread(self) -> tuple[Path, ...]:
        """Remove and return added recordings that could not be read."""
        n_read = len(self.paths) if self.read is None else len(self.read.reports)
        unread = self.paths[n_read:]
        if unread:
            # The worker no longer has the other recordings.
            self.paths, self.read_with = self.paths[:n_read], None
        return unread

    # Answers.

    def accept_recordings(self, read: ReadResult, options: ReadOptions) -> None:
        """
        Set the recordings; new ones are selected.

        :raises ModelMismatchError: if a given model is of another robot.
        """
        names = read.samples.names
        first = self.read is None and not self.stages
        if self.given and first:
            name, model = self.given[0].name, self.given[0].model
            missing = [joint for joint in model.joints if joint not in names]
            if missing:
                raise ModelMismatchError(
                    f'the model {name} is of another robot: it has the joints '
                    f'{", ".join(model.joints)}, and the recordings have {", ".join(names)}')
        # Recordings added since the last reading are selected as well.
        new = range(len(self.read.reports) if self.read else read.samples.n_runs,
                    read.samples.n_runs)
        # The joints that were read, also if they were not listed before.
        self.read, self.read_with = read, replace(options, joints=names)
        self.joints = self.joints or (*names, *read.left_out)
        joints = self.choice.joints or names
        runs = (*self.choice.runs, *new) if self.choice.runs else tuple(
            range(read.samples.n_runs))
        self.choice = replace(self.choice, joints=joints, runs=runs)
        if first and not self.given:
            self._use_all_samples_if_few_are_slow()
        if self.given and first:
            self._append(Stage(self.given[0].name, self.given[0].model, self.choice,
                               given=self.given[0].path,
                               warnings=report_of(self.given[0].model).warnings))

    def _use_all_samples_if_few_are_slow(self) -> None:
        """Select all samples of a fast recording, as `fit` does."""
        self.ungated = with_enough_motion(self.recording).ungated if self.choice.runs else ''
        if self.ungated:
            self.choice = replace(self.choice, all_samples=True)

    def learned(self, answer: Learned, choice: Choice) -> None:
        """Start a new branch with a fitted model; its joints are in the order of the arm."""
        joints = answer.model.joints
        if joints != choice.joints:
            choice = replace(choice, joints=joints)
            self.joints = (*joints, *(name for name in self.joints if name not in joints))
        self.choice, self.to_learn = choice, False
        self._append(Stage('gravity', answer.model, choice, warnings=warnings_of_fit(answer)))

    def diagnosed(self, answer: Diagnosis, job: Diagnose) -> None:
        """Store the diagnosis with the stage of its model."""
        for k, stage in enumerate(self.stages):
            if stage.model is job.model:
                held_out = stage.held_out or {
                    name: joint.rmse_before for name, joint in answer.joints.items()}
                self.stages[k] = replace(stage, diagnosis=answer, diagnosed_with=job.choice,
                                         held_out=held_out)

    def added(self, answer: Refit, job: Add) -> None:
        """Append a stage with added effects."""
        parent = next((k for k, s in enumerate(self.stages) if s.model is job.model), self.at)
        before, after = answer.by_joint()
        if parent is not None:
            # Both errors are on the same samples.
            self.stages[parent] = replace(self.stages[parent], held_out=before)
        self._append(Stage(_added_name(answer.added), answer.model, job.choice, parent,
                           answer.added, held_out=after, warnings=tuple(answer.warnings())))

    def planned(self, answer: Plan, job: PlanMotion) -> None:
        """Store a planned motion."""
        self._plan = (job, answer)

    @property
    def plan(self) -> tuple[PlanMotion, Plan] | None:
        """Return the motion planned for the current model and choice."""
        if self._plan is None or self.stage is None or self._plan[0].choice != self.choice \
                or self._plan[0].model is not self.stage.model:
            return None
        return self._plan

    def undo(self) -> str:
        """
        Undo the last addition and return its effects; its stage is kept.

        :raises DataError: if there is no addition.
        """
        stage = self.stage
        if stage is None or self.at is None:
            raise DataError('there is no model yet')
        if stage.parent is not None and stage.effects:
            self.at = stage.parent
            return ', '.join(stage.effects)
        back = undone(stage.model, now())
        self._append(Stage('before ' + stage.name, back, self.choice, self.at))
        return ', '.join(back.history[-1].effects)

    def select_stage(self, number: int) -> None:
        """Make a stage the current one; further additions start a new branch."""
        self.at, self.to_learn = number, False
        self.choice = self.stages[number].choice

    def describe(self, number: int, name: str, note: str) -> None:
        """Set the name and the note of a stage."""
        stage = self.stages[number]
        self.stages[number] = replace(stage, name=name.strip() or stage.name, note=note.strip())

    def _append(self, stage: Stage) -> None:
        self.stages.append(stage)
        self.at = len(self.stages) - 1


def _same(options: ReadOptions, done: ReadOptions | None) -> bool:
    """Return whether reading options are equal up to the order of joints."""
    if done is None or (options.joints is None) != (done.joints is None):
        return False
    return set(options.joints or ()) == set(done.joints or ()) \
        and replace(options, joints=None) == replace(done, joints=None)


def _added_name(effects: tuple[str, ...]) -> str:
    if len(effects) <= _MAX_NAMED:
        return '+ ' + ', '.join(effects)
    return f'+ {effects[0]} and {len(effects) - 1} more'
