"""
What is on the bench: recordings, the stages of the model, and what was found.

Free of Bokeh and of processes: a page asks it what to do next and tells it what came back.
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
from gravity_comp_ros.estimation.refit_result import Refit
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.history import undone
from gravity_comp_ros.planning.plan import Plan
from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.workbench.choice import Choice
from gravity_comp_ros.workbench.jobs import Add, Diagnose, Learn, PlanMotion, Read, ReadResult
from gravity_comp_ros.workbench.stages import Stage, warnings_of_fit

Value = TypeVar('Made')
# Of more effects that were added at once the name of a stage has the first.
_MOST_NAMED = 2


@dataclass(frozen=True)
class GivenModel:
    """A model file named on the command line."""

    path: Path
    model: GravityModel

    @property
    def name(self) -> str:
        """Return what the page calls it."""
        return self.path.name


class CacheKey:
    """What something that is kept was made of: an equal choice, and the very same things."""

    def __init__(self, choice: Choice, *things: object) -> None:
        self._choice, self._things = choice, things

    def __eq__(self, other: object) -> bool:
        return (isinstance(other, CacheKey) and self._choice == other._choice
                and len(self._things) == len(other._things)
                and all(a is b for a, b in zip(self._things, other._things)))


class SessionState:
    """One user's work: what was read, the stages of the model, and the choices."""

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
        self._kept: dict[str, tuple[object, Any]] = {}
        self._plan: tuple[PlanMotion, Plan] | None = None

    @property
    def stage(self) -> Stage | None:
        """Return the present state of the model."""
        return None if self.at is None else self.stages[self.at]

    @property
    def diagnosis(self) -> Diagnosis | None:
        """Return what was found beside the present model in what is chosen now."""
        stage = self.stage
        return stage.diagnosis if stage and stage.judged_with == self.choice else None

    @property
    def recording(self) -> Recording:
        """
        Return the chosen runs and joints.

        :raises DataError: if nothing was read or chosen.
        """
        if self.read is None:
            raise DataError('no recording has been read')
        samples, reports = self.read.samples, self.read.reports
        return self.kept('recording', CacheKey(self.choice, self.read),
                         lambda: self.choice.recording(samples, reports))

    def kept(self, name: str, key: object, make: Callable[[], Value]) -> Value:
        """Return what was made of the same key before; it is made where there is none."""
        known = self._kept.get(name)
        if known is None or known[0] != key:
            known = self._kept[name] = (key, make())
        made: Value = known[1]
        return made

    # What is to be done.

    def next_job(self) -> Read | Learn | Diagnose | None:
        """Return what is needed next: recordings, a model, or a diagnosis of it."""
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
        Return the job that adds effects to the present model.

        :raises DataError: if there is no model yet.
        """
        if self.stage is None:
            raise DataError('there is no model yet')
        return Add(self.choice, self.stage.model, effects)

    def planning(self, effects: tuple[str, ...] | None) -> PlanMotion:
        """
        Return the job that plans the next recording.

        :param effects: to settle; None for all that the diagnosis leaves open.
        :raises DataError: if there is no model or no diagnosis yet.
        """
        if self.stage is None or self.diagnosis is None:
            raise DataError('nothing has been looked for yet')
        return PlanMotion(self.choice, self.stage.model, self.diagnosis, effects)

    def learn(self, choice: Choice) -> None:
        """Choose what to learn from; a new model is due. Earlier stages stay in the history."""
        self.choice, self.to_learn = choice, True

    def judge(self, choice: Choice) -> None:
        """
        Choose what the present model is judged on.

        :raises DataError: if there is no model, or it is of other joints.
        """
        if self.stage is None:
            raise DataError('there is no model yet: learn one')
        if self.stage.model.joints != choice.joints:
            raise DataError(f'the model is of {", ".join(self.stage.model.joints)}: learn one of '
                            f'these joints, or choose those')
        self.choice = replace(choice, formulation=self.choice.formulation)

    def bring(self, path: Path) -> None:
        """Put one more recording on the bench; it is read next."""
        self.paths = (*self.paths, path)

    def give_back(self) -> tuple[Path, ...]:
        """Take away what was brought and could not be read."""
        known = len(self.paths) if self.read is None else len(self.read.reports)
        refused = self.paths[known:]
        if refused:
            # The process that reads has lost the others.
            self.paths, self.read_with = self.paths[:known], None
        return refused

    # What came back.

    def take(self, read: ReadResult, options: ReadOptions) -> None:
        """
        Put recordings on the bench, all of them chosen at first.

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
        # What was brought since is chosen as well.
        new = range(len(self.read.reports) if self.read else read.samples.n_runs,
                    read.samples.n_runs)
        # The same samples, by their names.
        self.read, self.read_with = read, replace(options, joints=names)
        self.joints = self.joints or (*names, *read.left_out)
        joints = self.choice.joints or names
        runs = (*self.choice.runs, *new) if self.choice.runs else tuple(
            range(read.samples.n_runs))
        self.choice = replace(self.choice, joints=joints, runs=runs)
        if first and not self.given:
            self._use_fast_samples_where_few_are_slow()
        if self.given and first:
            self._go_on(Stage(self.given[0].name, self.given[0].model, self.choice,
                              given=self.given[0].path,
                              warnings=report_of(self.given[0].model).warnings))

    def _use_fast_samples_where_few_are_slow(self) -> None:
        """Judge a model on the samples that `fit` takes of a fast recording: all."""
        self.ungated = with_enough_motion(self.recording).ungated if self.choice.runs else ''
        if self.ungated:
            self.choice = replace(self.choice, all_samples=True)

    def learned(self, answer: Learned, choice: Choice) -> None:
        """Begin anew with a fitted model; its joints are in the order of the arm."""
        joints = answer.model.joints
        if joints != choice.joints:
            choice = replace(choice, joints=joints)
            self.joints = (*joints, *(name for name in self.joints if name not in joints))
        self.choice, self.to_learn = choice, False
        self._go_on(Stage('gravity', answer.model, choice, warnings=warnings_of_fit(answer)))

    def diagnosed(self, answer: Diagnosis, job: Diagnose) -> None:
        """Keep what was found beside the model that it is about."""
        for k, stage in enumerate(self.stages):
            if stage.model is job.model:
                held_out = stage.held_out or {
                    name: joint.rmse_before for name, joint in answer.joints.items()}
                self.stages[k] = replace(stage, diagnosis=answer, judged_with=job.choice,
                                         held_out=held_out)

    def added(self, answer: Refit, job: Add) -> None:
        """Go on with a model that has more effects."""
        parent = next((k for k, s in enumerate(self.stages) if s.model is job.model), self.at)
        before, after = answer.by_joint()
        if parent is not None:
            # Of the same samples as the error after it.
            self.stages[parent] = replace(self.stages[parent], held_out=before)
        self._go_on(Stage(_added_name(answer.added), answer.model, job.choice, parent,
                          answer.added, held_out=after, warnings=tuple(answer.warnings())))

    def planned(self, answer: Plan, job: PlanMotion) -> None:
        """Keep a planned motion as long as it belongs to what is shown."""
        self._plan = (job, answer)

    @property
    def plan(self) -> tuple[PlanMotion, Plan] | None:
        """Return what was planned for the present model and choice."""
        if self._plan is None or self.stage is None or self._plan[0].choice != self.choice \
                or self._plan[0].model is not self.stage.model:
            return None
        return self._plan

    def undo(self) -> str:
        """
        Go back to before the last addition and return its name; the stage stays in the history.

        :raises DataError: if there is none.
        """
        stage = self.stage
        if stage is None or self.at is None:
            raise DataError('there is no model yet')
        if stage.parent is not None and stage.effects:
            self.at = stage.parent
            return ', '.join(stage.effects)
        back = undone(stage.model, now())
        self._go_on(Stage('before ' + stage.name, back, self.choice, self.at))
        return ', '.join(back.history[-1].effects)

    def go_to(self, number: int) -> None:
        """Go to a stage; what is added from there on is a new branch."""
        self.at, self.to_learn = number, False
        self.choice = self.stages[number].choice

    def describe(self, number: int, name: str, note: str) -> None:
        """Give a stage a name and a note of the user's own."""
        stage = self.stages[number]
        self.stages[number] = replace(stage, name=name.strip() or stage.name, note=note.strip())

    def _go_on(self, stage: Stage) -> None:
        self.stages.append(stage)
        self.at = len(self.stages) - 1


def _same(options: ReadOptions, done: ReadOptions | None) -> bool:
    """Return whether the same was read; the order of joints is of no account."""
    if done is None or (options.joints is None) != (done.joints is None):
        return False
    return set(options.joints or ()) == set(done.joints or ()) \
        and replace(options, joints=None) == replace(done, joints=None)


def _added_name(effects: tuple[str, ...]) -> str:
    if len(effects) <= _MOST_NAMED:
        return '+ ' + ', '.join(effects)
    return f'+ {effects[0]} and {len(effects) - 1} more'
