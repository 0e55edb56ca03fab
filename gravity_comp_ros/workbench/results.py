"""Results of a session for the page: errors, report contents, findings and command lines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import compare_model
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.errors import DataError, GravityCompError
from gravity_comp_ros.evaluation.compare import Comparison
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.views.arm import find_arm
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.stages import MODEL_FILE, Stage
import numpy as np

# Maximum number of cached results; a comparison or a residual has all samples.
_MAX_CACHED = 16
Value = TypeVar('Value')


class Results:
    """
    Derived results of one session, cached until their inputs change.

    `other` is the name of the model whose errors are shown with those of the current one;
    '' for the stage before an addition.
    """

    def __init__(self, session: Session) -> None:
        self.session, self.other = session, ''
        self._cache: dict[tuple[int, ...], tuple[tuple[object, ...], Any]] = {}

    def _cached(self, make: Callable[[], Value], *inputs: object) -> Value:
        """Return the cached value of identical inputs, computed if there is none."""
        key = tuple(map(id, inputs))
        # Inputs are kept, so that no other object gets the id of one; the latest used come last.
        entry = self._cache.pop(key, None) or (inputs, make())
        self._cache[key] = entry
        if len(self._cache) > _MAX_CACHED:
            del self._cache[next(iter(self._cache))]
        value: Value = entry[1]
        return value

    @property
    def recording(self) -> Recording:
        """
        Return the chosen runs and joints.

        :raises DataError: if no recording was read or selected.
        """
        choice, read = self.session.choice, self.session.read
        if read is None:
            raise DataError('no recording has been read')
        return self._cached(lambda: choice.recording(read.samples, read.reports), choice, read)

    def contents(self) -> Contents:
        """
        Return the contents of the views: of the current model, or a constant torque without one.

        :raises DataError: if the recordings have not been read, or no sample passes the gate.
        """
        session = self.session
        if not session.is_read:
            raise DataError('the recordings are being read')
        stage, before = session.stage or self._cached(
            self._constant, 'constant', session.choice, session.read), self._before()
        base = self._cached(lambda: self._contents(stage, before), 'contents', session.choice,
                            session.read, stage.model, before and before.model)
        # A new diagnosis does not change the errors.
        diagnosis = session.diagnosis
        return self._cached(lambda: replace(base, diagnosis=diagnosis,
                                            next_command=self._next_command()), base, diagnosis)

    def _before(self) -> Stage | None:
        """Return the model to compare with."""
        session, models = self.session, self.others()
        if self.other in models:
            return models[self.other]
        at = session.at if session.stage and session.stage.effects else None
        return list(models.values())[at - 1] if at else None

    def _contents(self, stage: Stage, before: Stage | None) -> Contents:
        recording = self.recording.select_joints(stage.model.joints)
        return Contents(
            recording.samples, stage.model, self.compared(stage.model),
            recording.gated.sentence(), recording.reports,
            '\n'.join(self.session.commands()), previous=self.errors(before) if before else {},
            previous_name=before.name if before else '',
            arm=find_arm(self.session.paths, stage.model.joints, self.session.choice.urdf))

    def compared(self, model: GravityModel) -> Comparison:
        """
        Return the errors of a model on the chosen samples, equal to those of `compare`.

        :raises DataError: if no recording was read.
        :raises ModelMismatchError: if a joint of the model is missing.
        """
        return self._cached(lambda: compare_model(model, self.recording.select_joints(
            model.joints)), 'compared', self.session.choice, self.session.read, model)

    def errors(self, stage: Stage) -> dict[str, float]:
        """Return the RMSE by joint in N·m of a stage on the chosen samples; {} without joints."""
        try:
            return {name: x.rmse for name, x in self.compared(stage.model).joints.items()}
        except GravityCompError:
            return {}

    def _constant(self) -> Stage:
        """Return the model before the first fit, a constant torque."""
        samples = self.recording.samples
        if not samples.n_samples:
            raise DataError('the recordings are empty')
        mean, spread = samples.tau.mean(axis=0), samples.tau.std(axis=0)
        torques = tuple(Expansion(np.zeros(1, dtype=np.int64), mean[n:n + 1])
                        for n in range(samples.n_joints))
        return Stage('constant torque', GravityModel(
            samples.names, 'per_joint', torques, None, spread, Coverage(
                samples.q.min(axis=0), samples.q.max(axis=0), samples.n_samples, samples.n_runs)))

    def slow_warning(self) -> str:
        """Return a warning if almost no sample is slow, otherwise an empty string."""
        session = self.session
        if session.read is None or not session.choice.runs:
            return ''
        if session.choice.gate is None:
            return session.ungated
        return self._cached(self._count_slow, 'slow', session.choice, session.read)

    def _count_slow(self) -> str:
        recording = self.recording
        try:
            n_slow = len(recording.slow)
        except DataError:
            n_slow = 0
        if n_slow >= FactOptions().min_slow_samples:
            return ''
        return (f'The slow-motion gate keeps only {n_slow} of {len(recording)} samples. Use all '
                f'samples, or raise the speed limit, under "Samples".')

    def findings(self) -> list[tuple[Finding, tuple[str, ...]]]:
        """Return findings with the targets of their Add button, none for no button."""
        diagnosis = self.session.diagnosis
        return [(f, self._absent(f.to_add)) for f in (diagnosis.findings if diagnosis else ())]

    def to_add(self) -> tuple[str, ...]:
        """Return the targets to add that the model of the stage does not have."""
        diagnosis = self.session.diagnosis
        return self._absent(diagnosis.to_add if diagnosis else ())

    def _absent(self, targets: Sequence[str]) -> tuple[str, ...]:
        """Return the targets that the model of the stage does not have."""
        stage = self.session.stage
        present = {effect.target for effect in stage.model.applied.effects} if stage else set()
        return tuple(name for name in targets if name not in present)

    def _next_command(self) -> str:
        """Return the command line that adds the effects to add."""
        targets, session, stage = self.to_add(), self.session, self.session.stage
        if not targets or stage is None:
            return ''
        model = stage.given.resolve() if stage.given else MODEL_FILE
        return session.choice.add_command(targets, session.paths, model)

    def others(self) -> dict[str, Stage]:
        """Return the models to compare with by name: other stages, and further model files."""
        session = self.session
        own = {f'{k + 1}. {stage.name}': stage for k, stage in enumerate(session.stages)}
        every = {**own, **{stage.name: stage for stage in session.given[1:]}}
        return {name: replace(stage, name=name) for name, stage in every.items()
                if stage is not session.stage}
