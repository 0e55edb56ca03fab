"""
Session of the workbench: errors, report contents, findings and command lines.

Does not depend on Bokeh or on processes.
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
from gravity_comp_ros.workbench.session_state import CacheKey, SessionState
from gravity_comp_ros.workbench.stages import Stage
import numpy as np

# Verdicts with an Add button.
ADDABLE = (*FOUND, 'ambiguous', 'weak')
# Minimum number of slow samples for a reliable error.
MIN_SLOW = 50
# Maximum number of cached comparisons; each has the residuals of all samples.
_MAX_CACHED = 4


class Session(SessionState):
    """State of one user's work, with its derived results."""

    _errors: tuple[tuple[CacheKey, Comparison], ...] = ()

    def contents(self) -> Contents:
        """
        Return the contents of the views of the current model.

        :raises DataError: if there is no model yet, or no sample passes the gate.
        """
        stage = self.stage
        if stage is None or self.read is None:
            raise DataError('there is no model yet')
        key = CacheKey(self.choice, stage.model, self.read)
        contents = self.cached('contents', key, lambda: self._contents(stage))
        # A new diagnosis does not change the errors.
        key = CacheKey(self.choice, contents, self.diagnosis)
        return self.cached('diagnosed', key, lambda: contents if
                           contents.diagnosis is self.diagnosis else replace(
                               contents, diagnosis=self.diagnosis,
                               next_command=self._next_command()))

    def _contents(self, stage: Stage) -> Contents:
        recording = self.recording.select_joints(stage.model.joints)
        previous = None if stage.parent is None else self.stages[stage.parent]
        other = self.compared(previous.model) if previous else None
        predicted = predict_torque(stage.model, recording.samples)
        return Contents(
            recording.samples, predicted, stage.model, self.compared(stage.model, predicted),
            recording.gated.sentence(), recording.reports,
            Origin('\n'.join(self.commands()), now()), self.diagnosis,
            {name: x.rmse for name, x in other.joints.items()} if other else {},
            previous.name if previous else '', next_command=self._next_command(),
            arm=self.arm(stage.model.joints))

    def compared(self, model: GravityModel, predicted: FloatArray | None = None) -> Comparison:
        """
        Return the errors of a model on the chosen samples, equal to those of `compare`.

        The latest are cached.

        :raises DataError: if no recording was read.
        :raises ModelMismatchError: if a joint of the model is missing.
        """
        choice = replace(self.choice, joints=model.joints)
        key = CacheKey(choice, self.read, model)
        errors = next((errors for known, errors in self._errors if known == key), None)
        if errors is None:
            same = choice == self.choice
            recording = self.recording if same or self.read is None else choice.recording(
                self.read.samples, self.read.reports)
            errors = compare_model(model, recording, predicted)
            self._errors = ((key, errors), *self._errors)[:_MAX_CACHED]
        return errors

    def arm(self, joints: tuple[str, ...]) -> Arm | None:
        """Return the arm of these joints; None without a description."""
        return self.cached('arm', (self.paths, joints),
                           lambda: find_arm(self.paths, joints, self.urdf))

    def preview(self) -> Contents:
        """
        Return the contents of the views before the first fit, with a constant torque as model.

        :raises DataError: if no recording was read or selected.
        """
        return self.cached('preview', CacheKey(self.choice, self.read), self._constant)

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

    def slow_warning(self) -> str:
        """Return a warning if almost no sample is slow, otherwise an empty string."""
        return self.cached('few', CacheKey(self.choice, self.read), self._count_slow)

    def _count_slow(self) -> str:
        if self.read is None or not self.choice.runs:
            return ''
        if self.choice.all_samples:
            return self.ungated
        recording = self.recording
        try:
            n_slow = len(recording.slow)
        except DataError:
            n_slow = 0
        if n_slow >= MIN_SLOW:
            return ''
        return (f'Only {n_slow} of {len(recording)} samples are slow: the recordings contain fast '
                f'motion. Use all samples, or raise the speed limit, under "Samples".')

    def findings(self) -> list[tuple[Finding, str]]:
        """Return findings with the target of their Add button, '' for no button."""
        stage, diagnosis = self.stage, self.diagnosis
        if stage is None or diagnosis is None:
            return []
        return [(f, target(f.effect, f.joint) if f.effect and f.verdict in ADDABLE
                 and not stage.model.applied.has(f.effect, f.joint) else '')
                for f in diagnosis.findings]

    def commands(self) -> list[str]:
        """Return command lines that reproduce the model and its evaluation."""
        if self.at is None or not self.paths:
            return []
        return [*tree.command_lines(self.stages, self.at, self.paths, self.topic),
                *tree.reports(self.choice, self.paths, self.topic)]

    def _next_command(self) -> str:
        """Return the command line that adds the established and likely effects."""
        targets = [t for f, t in self.findings() if t and f.verdict in FOUND]
        if not targets:
            return ''
        return tree.add_command(tuple(targets), self.choice, self.paths, self.topic)

    def residual(self, model: GravityModel) -> FloatArray:
        """
        Return the residual of a model on all chosen samples, (M, N) in N·m, for its joints.

        :raises ModelMismatchError: if a joint of the model is missing.
        """
        samples = self.recording.samples.joints(model.joints)
        return np.asarray(samples.tau - predict_torque(model, samples))

    def facts(self, key: str) -> dict[str, str]:
        """Return formulation, note, recordings and axes of a model of `models`."""
        model = next(model for name, _, model in self.models() if name == key)
        terms = sum(len(torque.weights) for torque in model.torques)
        facts = {'formulation': f'{model.formulation}, {terms} terms', 'note': '',
                 'fitted to': '',
                 'axes': _short(model.geometry.source) if model.geometry else 'not known'}
        if key.startswith('stage '):
            stage = self.stages[int(key.split()[1])]
            facts['note'] = stage.note
            facts['fitted to'] = str(stage.given) if stage.given else self._fitted_to(stage)
        return facts

    def _fitted_to(self, stage: Stage) -> str:
        runs = ', '.join(self.paths[run].name for run in stage.choice.runs)
        gate = ' '.join(stage.choice.gate_options()).replace('--', '') or 'slow samples'
        return f'{runs}; {gate}'

    def models(self) -> list[tuple[str, str, GravityModel]]:
        """Return key, name and model of all models that can be compared."""
        own = [(f'stage {k}', f'{k + 1}. {s.name}', s.model) for k, s in enumerate(self.stages)]
        return own + [(f'file {k}', g.name, g.model) for k, g in enumerate(self.given) if k]


def _short(source: str) -> str:
    """Return the name of a file without its folder; other sources unchanged."""
    return source if ' in ' in source else Path(source).name
