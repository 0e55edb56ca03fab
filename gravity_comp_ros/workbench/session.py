"""
What the page shows of the work: errors, views, what was found, commands.

Free of Bokeh and of processes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gravity_comp_ros.api.provenance import now
from gravity_comp_ros.api.steps import compare_model
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.diagnosis.wording import FOUND
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.evaluation.compare import compare, Comparison
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.report.arm import Arm, find_arm
from gravity_comp_ros.report.contents import Contents, Origin
from gravity_comp_ros.workbench import stages as tree
from gravity_comp_ros.workbench.choice import Choice
from gravity_comp_ros.workbench.stages import Stage
from gravity_comp_ros.workbench.session_state import GivenModel, CacheKey, SessionState
import numpy as np

# A finding with one of these is worth adding.
ADDABLE = (*FOUND, 'ambiguous', 'weak')
# Fewer slow samples than this say little.
FEW = 50
# Comparisons that are kept; each has a residual of all samples.
_MOST_ERRORS = 4


class Session(SessionState):
    """One user's work, and what is shown of it."""

    def __init__(self, paths: tuple[Path, ...], choice: Choice = Choice(),
                 given: tuple[GivenModel, ...] = (), topic: str | None = None,
                 urdf: Path | None = None) -> None:
        super().__init__(paths, choice, given, topic, urdf)
        self._errors: list[tuple[CacheKey, Comparison]] = []

    def compared(self, model: GravityModel) -> Comparison:
        """
        Return the errors of a model on the chosen samples, as `compare` gives them.

        :raises ModelMismatchError: if they lack a joint of the model.
        """
        if self.read is None:
            raise DataError('no recording has been read')
        return self._compared(model)

    def contents(self) -> Contents:
        """
        Return what the views show of the present model.

        :raises DataError: if there is no model yet, or no sample passes the gate.
        """
        stage = self.stage
        if stage is None or self.read is None:
            raise DataError('there is no model yet')
        key = CacheKey(self.choice, stage.model, self.read)
        made = self.kept('contents', key, lambda: self._make(stage))
        # What was found changes no error.
        return self.kept('diagnosed', CacheKey(self.choice, made, self.diagnosis), lambda: made if
                         made.diagnosis is self.diagnosis else replace(
                             made, diagnosis=self.diagnosis, next_command=self._next_command()))

    def _make(self, stage: Stage) -> Contents:
        recording = self.recording.select_joints(stage.model.joints)
        previous = None if stage.parent is None else self.stages[stage.parent]
        other = self._compared(previous.model) if previous else None
        predicted = predict_torque(stage.model, recording.samples)
        return Contents(
            recording.samples, predicted, stage.model, self._compared(stage.model, predicted),
            recording.gated.sentence(), recording.reports,
            Origin('\n'.join(self.commands()), now()), self.diagnosis,
            {name: x.rmse for name, x in other.joints.items()} if other else {},
            previous.name if previous else '', next_command=self._next_command(),
            arm=self.arm(stage.model.joints))

    def _compared(self, model: GravityModel, predicted: FloatArray | None = None) -> Comparison:
        """Return the errors of a model on what is chosen; those of the latest models are kept."""
        choice = replace(self.choice, joints=model.joints)
        key = CacheKey(choice, self.read, model)
        found = next((errors for known, errors in self._errors if known == key), None)
        if found is None:
            same = choice == self.choice
            recording = self.recording if same or self.read is None else choice.recording(
                self.read.samples, self.read.reports)
            found = compare_model(model, recording, predicted)
            self._errors = [(key, found), *self._errors][:_MOST_ERRORS]
        return found

    def arm(self, joints: tuple[str, ...]) -> Arm | None:
        """Return the arm of these joints, if a description says what it looks like."""
        return self.kept('arm', (self.paths, joints),
                         lambda: find_arm(self.paths, joints, self.urdf))

    def preview(self) -> Contents:
        """
        Return what the views show before there is a model: a constant torque is the model.

        :raises DataError: if nothing was read or chosen.
        """
        return self.kept('preview', CacheKey(self.choice, self.read), self._constant)

    def _constant(self) -> Contents:
        recording = self.recording
        samples = recording.samples
        if not samples.n_samples:
            raise DataError('the recordings are empty')
        mean, spread = samples.tau.mean(axis=0), samples.tau.std(axis=0)
        torques = tuple(Expansion(np.zeros(1, dtype=np.int64), mean[n:n + 1])
                        for n in range(samples.n_joints))
        model = GravityModel(samples.names, 'per_joint', torques, None, spread, Coverage(
            samples.q.min(axis=0), samples.q.max(axis=0), samples.n_samples, samples.n_runs))
        return Contents(samples, predict_torque(model, samples), model, compare(model, samples),
                        f'all {samples.n_samples} samples, against a constant torque',
                        recording.reports, Origin('\n'.join(self.commands()), now()),
                        arm=self.arm(samples.names))

    def few_slow(self) -> str:
        """Return what follows where nearly no sample is slow, nothing otherwise."""
        return self.kept('few', CacheKey(self.choice, self.read), self._count_slow)

    def _count_slow(self) -> str:
        if self.read is None or not self.choice.runs:
            return ''
        if self.choice.all_samples:
            return self.ungated
        recording = self.recording
        try:
            kept = len(recording.slow)
        except DataError:
            kept = 0
        if kept >= FEW:
            return ''
        return (f'Only {kept} of {len(recording)} samples are slow: these recordings are of '
                f'fast motion. Use all samples, or raise the speed limit, under "Samples".')

    def findings(self) -> list[tuple[Finding, str]]:
        """Return findings with what *Add* would add, or nothing where that makes no sense."""
        stage, diagnosis = self.stage, self.diagnosis
        if stage is None or diagnosis is None:
            return []
        return [(f, target(f.effect, f.joint) if f.effect and f.verdict in ADDABLE
                 and not stage.model.applied.has(f.effect, f.joint) else '')
                for f in diagnosis.findings]

    def commands(self) -> list[str]:
        """Return command lines that do the same."""
        if self.at is None or not self.paths:
            return []
        return [*tree.command_lines(self.stages, self.at, self.paths, self.topic),
                *tree.reports(self.choice, self.paths, self.topic)]

    def _next_command(self) -> str:
        """Return the command line that adds what was found to the model when it is saved."""
        targets = [t for f, t in self.findings() if t and f.verdict in FOUND]
        if not targets:
            return ''
        return tree.add_command(tuple(targets), self.choice, self.paths, self.topic)

    def residual(self, model: GravityModel) -> FloatArray:
        """
        Return what a model leaves of all chosen samples, (M, N) in N·m of its own joints.

        :raises ModelMismatchError: if they lack a joint of the model.
        """
        samples = self.recording.samples.joints(model.joints)
        return np.asarray(samples.tau - predict_torque(model, samples))

    def facts(self, key: str) -> dict[str, str]:
        """Return what a model of `models` was made from and what was noted of it."""
        model = next(model for name, _, model in self.models() if name == key)
        terms = sum(len(torque.weights) for torque in model.torques)
        told = {'formulation': f'{model.formulation}, {terms} terms', 'note': '',
                'learned from': '',
                'axes': _short(model.geometry.source) if model.geometry else 'not known'}
        if key.startswith('stage '):
            stage = self.stages[int(key.split()[1])]
            told['note'] = stage.note
            told['learned from'] = str(stage.given) if stage.given else self._learned_from(stage)
        return told

    def _learned_from(self, stage: Stage) -> str:
        runs = ', '.join(self.paths[run].name for run in stage.choice.runs)
        gate = ' '.join(stage.choice.gate_words()).replace('--', '') or 'slow samples'
        return f'{runs}; {gate}'

    def models(self) -> list[tuple[str, str, GravityModel]]:
        """Return key, name and model of all that can be compared."""
        own = [(f'stage {k}', f'{k + 1}. {s.name}', s.model) for k, s in enumerate(self.stages)]
        return own + [(f'file {k}', g.name, g.model) for k, g in enumerate(self.given) if k]


def _short(source: str) -> str:
    """Return the name of a file without its folder; other sources as they are."""
    return source if ' in ' in source else Path(source).name
