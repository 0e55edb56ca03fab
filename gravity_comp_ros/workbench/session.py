"""
What is on the bench: recordings, the model with its history, and what was found.

Free of Bokeh and of processes: a page asks it what to do next and tells it what came back.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
import shlex

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding
from gravity_comp_ros.diagnosis.wording import FOUND
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.evaluation.compare import compare, Comparison
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.history import undone
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.report.contents import Contents, Origin
from gravity_comp_ros.workbench.jobs import (
    Add, Added, Ask, Choice, chosen, Learn, Learned, now, slow_part, WasRead)
import numpy as np

# A finding with one of these is worth adding.
ADDABLE = (*FOUND, 'ambiguous', 'weak')


@dataclass(frozen=True)
class Stage:
    """
    One state of the model on its way, with its held-out RMSE by joint in N·m.

    `name` says what was done; `diagnosis` is None until one is made.
    """

    name: str
    model: GravityModel
    held_out: Mapping[str, float] = field(default_factory=dict)
    diagnosis: Diagnosis | None = None


class Session:
    """One user's work: what was read, the stages of the model, and the choices."""

    def __init__(self, paths: tuple[Path, ...], formulation: str = 'potential',
                 models: tuple[tuple[str, GravityModel], ...] = ()) -> None:
        self.paths, self.formulation, self.given = paths, formulation, models
        self.read: WasRead | None = None
        self.choice = Choice((), ())
        self.stages: list[Stage] = []

    @property
    def stage(self) -> Stage | None:
        """Return the present state of the model."""
        return self.stages[-1] if self.stages else None

    @property
    def samples(self) -> JointSamples:
        """
        Return the samples of the chosen runs and the model's joints.

        :raises DataError: if nothing was read or chosen.
        """
        if self.read is None:
            raise DataError('no recording has been read')
        return chosen(self.read.samples, self.choice)

    def take(self, read: WasRead) -> None:
        """
        Put recordings on the bench, all of them chosen.

        :raises ModelMismatchError: if a given model is of another robot.
        """
        self.read = read
        joints = read.samples.names
        if self.given:
            name, model = self.given[0]
            missing = [joint for joint in model.joints if joint not in joints]
            if missing:
                raise ModelMismatchError(
                    f'the model {name} is of another robot: it has the joints '
                    f'{", ".join(model.joints)}, and the recordings have {", ".join(joints)}')
            joints = model.joints
            self.stages = [Stage(name, model)]
        self.choice = Choice(tuple(range(read.samples.n_runs)), joints)

    def choose(self, runs: tuple[int, ...], joints: tuple[str, ...], formulation: str) -> None:
        """Choose what to work with; a model of other joints or formulation is let go."""
        stage = self.stage
        kept = stage is not None and stage.model.joints == joints \
            and formulation == self.formulation
        self.choice, self.formulation = Choice(runs, joints), formulation
        if not kept:
            self.stages = []
        elif stage is not None:
            # What was found belongs to other data.
            self.stages[-1] = replace(stage, diagnosis=None)

    def next_job(self) -> Learn | Ask | None:
        """Return what is needed next: a model, or a diagnosis of it."""
        if self.read is None or not self.choice.runs or not self.choice.joints:
            return None
        if self.stage is None:
            return Learn(self.choice, self.formulation)
        if self.stage.diagnosis is None:
            return Ask(self.choice, self.stage.model)
        return None

    def adding(self, effects: tuple[str, ...]) -> Add:
        """
        Return the job that adds effects to the present model.

        :raises DataError: if there is no model yet.
        """
        if self.stage is None:
            raise DataError('there is no model yet')
        return Add(self.choice, self.stage.model, effects)

    def learned(self, answer: Learned) -> None:
        """Begin anew with a fitted model."""
        self.stages = [Stage('gravity', answer.model, answer.held_out)]

    def diagnosed(self, answer: Diagnosis) -> None:
        """Keep what was found beside the present model."""
        if self.stages:
            self.stages[-1] = replace(self.stages[-1], diagnosis=answer)

    def added(self, answer: Added) -> None:
        """Go on with a model that has more effects."""
        before, after = answer.result.by_joint()
        if self.stages and not self.stages[-1].held_out:
            self.stages[-1] = replace(self.stages[-1], held_out=before)
        self.stages.append(Stage('+ ' + ', '.join(answer.result.added), answer.model, after))

    def undo(self) -> str:
        """
        Take the last addition back and return its name.

        :raises DataError: if there is none.
        """
        stage = self.stage
        if stage is None:
            raise DataError('there is no model yet')
        back = undone(stage.model, now())
        if len(self.stages) > 1:
            self.stages.pop()
            self.stages[-1] = replace(self.stages[-1], model=back)
        else:
            self.stages = [Stage('before ' + stage.name, back)]
        return ', '.join(back.history[-1].effects)

    def compared(self, model: GravityModel) -> Comparison:
        """Return the errors of a model on the slow part of the chosen samples."""
        samples = self.samples
        return compare(model, slow_part(samples), samples)

    def contents(self) -> Contents:
        """
        Return what the views show of the present model.

        :raises DataError: if there is no model yet, or no sample is slow.
        """
        stage = self.stage
        if stage is None or self.read is None:
            raise DataError('there is no model yet')
        samples = self.samples.joints(stage.model.joints)
        slow = slow_part(samples)
        previous = self.stages[-2] if len(self.stages) > 1 else None
        other = compare(previous.model, slow, samples) if previous else None
        return Contents(
            samples, predict_torque(stage.model, samples), stage.model,
            compare(stage.model, slow, samples),
            f'{slow.n_samples} of {samples.n_samples} samples, the slow ones',
            tuple(self.read.reports[run] for run in self.choice.runs),
            Origin('\n'.join(self.commands()), now()), stage.diagnosis,
            {name: x.rmse for name, x in other.joints.items()} if other else {},
            previous.name if previous else '')

    def preview(self) -> Contents:
        """
        Return what the views show before there is a model: a constant torque is the model.

        :raises DataError: if nothing was read or chosen.
        """
        samples = self.samples
        if self.read is None or not samples.n_samples:
            raise DataError('no recording has been read')
        mean, spread = samples.tau.mean(axis=0), samples.tau.std(axis=0)
        torques = tuple(Expansion(np.zeros(1, dtype=np.int64), mean[n:n + 1])
                        for n in range(samples.n_joints))
        model = GravityModel(samples.names, 'per_joint', torques, None, spread, Coverage(
            samples.q.min(axis=0), samples.q.max(axis=0), samples.n_samples, samples.n_runs))
        return Contents(samples, predict_torque(model, samples), model, compare(model, samples),
                        f'all {samples.n_samples} samples, against a constant torque',
                        tuple(self.read.reports[run] for run in self.choice.runs),
                        Origin('\n'.join(self.commands()), now()))

    def findings(self) -> list[tuple[Finding, str]]:
        """Return findings with what *Add* would add, or nothing where that makes no sense."""
        stage = self.stage
        if stage is None or stage.diagnosis is None:
            return []
        return [(f, target_of(f) if f.effect and f.verdict in ADDABLE
                 and not stage.model.applied.has(f.effect, f.joint) else '')
                for f in stage.diagnosis.findings]

    def commands(self) -> list[str]:
        """Return command lines that do the same."""
        bags = ' '.join(shlex.quote(str(self.paths[run])) for run in self.choice.runs)
        if self.read is not None and self.choice.joints != self.read.samples.names:
            joints = f' --joints {shlex.quote(",".join(self.choice.joints))}'
        else:
            joints = ''
        lines = []
        model = 'arm.json'
        if self.given and self.stages and self.stages[0].name == self.given[0][0]:
            model = self.given[0][0]
        else:
            lines.append(f'gravity_comp fit {bags}{joints} --formulation {self.formulation} '
                         f'-o {model}')
        lines += [f'gravity_comp add {shlex.quote(stage.name[2:].replace(", ", ","))} '
                  f'--model {shlex.quote(model)} {bags}' for stage in self.stages[1:]]
        return [*lines, f'gravity_comp diagnose {bags} --model {shlex.quote(model)} '
                f'--html report.html']

    def others(self) -> list[tuple[str, GravityModel]]:
        """Return the models that the present one can be compared with, and their names."""
        earlier = [(stage.name, stage.model) for stage in self.stages[:-1]]
        given = [(name, model) for name, model in self.given
                 if self.stage is None or model is not self.stage.model]
        return [*earlier[::-1], *given]


def target_of(finding: Finding) -> str:
    """Return a finding as `add` takes it."""
    return f'{finding.effect}:{finding.joint}' if finding.joint else str(finding.effect)
