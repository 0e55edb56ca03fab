"""The long work of the workbench, done by a process of its own: what is asked, and answered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gravity_comp_ros.api.recording import read_each, Recording
from gravity_comp_ros.api.steps import add_to_model, fit_model
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.estimation.fit import FitOptions, FitResult
from gravity_comp_ros.estimation.refit import RefitOptions
from gravity_comp_ros.estimation.refit_result import Refit
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.recordings.bag import ReadOptions, ReadReport
from gravity_comp_ros.workbench.choice import Choice

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Read:
    """
    Read recordings; the worker keeps them for the jobs that follow.

    `model` names the model that says which joints there are, if one does.
    """

    paths: tuple[Path, ...]
    options: ReadOptions
    model: str = ''


@dataclass(frozen=True)
class WasRead:
    """All samples, and a report on each recording."""

    samples: JointSamples
    reports: tuple[ReadReport, ...]


@dataclass(frozen=True)
class Learn:
    """Fit gravity to the chosen samples."""

    choice: Choice


@dataclass(frozen=True)
class Ask:
    """Diagnose the chosen runs beside a model."""

    choice: Choice
    model: GravityModel


@dataclass(frozen=True)
class Add:
    """Add effects, as `add` takes them, and refit."""

    choice: Choice
    model: GravityModel
    effects: tuple[str, ...]


Job = Read | Learn | Ask | Add
Answer = WasRead | FitResult | Diagnosis | Refit


class Bench:
    """Does the jobs; keeps what was read between them."""

    def __init__(self) -> None:
        self._read: WasRead | None = None

    def work(self, job: Job, progress: Progress) -> Answer:
        """
        Return the answer to a job.

        :raises GravityCompError: if it cannot be done, with one line that says why.
        """
        if isinstance(job, Read):
            return self._reading(job, progress)
        if self._read is None:
            raise DataError('no recording has been read')
        recording = job.choice.recording(self._read.samples, self._read.reports)
        if isinstance(job, Learn):
            return learn(recording, job.choice, progress)
        if isinstance(job, Ask):
            return diagnose(recording.samples, job.model, progress=progress)
        speeds = RefitOptions.chosen(job.choice.all_samples, job.choice.max_speed)
        return add_to_model(job.model, recording, job.effects, speeds, progress)

    def _reading(self, job: Read, progress: Progress) -> WasRead:
        try:
            found = read_each(job.paths, job.options, progress)
        except ModelMismatchError as problem:
            if not job.model:
                raise
            raise ModelMismatchError(f'the model {job.model} is of another robot: {problem}'
                                     ) from problem
        self._read = WasRead(concatenate(r.samples for r in found),
                             tuple(r.report for r in found))
        return self._read


def learn(recording: Recording, choice: Choice, progress: Progress) -> FitResult:
    """Return the model that `gravity_comp fit` gives."""
    result, _ = fit_model(recording, FitOptions(choice.formulation), progress=progress)
    # As `fit --joints --urdf none` has it.
    provenance = {**result.model.provenance, 'description': None, 'joint_order': '--joints'}
    return replace(result, model=replace(result.model, provenance=provenance))


def described(job: Job) -> str:
    """Return what is being done, in words."""
    words: dict[type[Any], str] = {Read: 'Reading', Learn: 'Learning gravity',
                                   Ask: 'Looking for what is missing'}
    return f'Adding {", ".join(job.effects)}' if isinstance(job, Add) else words[type(job)]
