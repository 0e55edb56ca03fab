"""The long work of the workbench, done by a process of its own: what is asked, and answered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime, UTC
from pathlib import Path
from typing import Any

from gravity_comp_ros.data.holdout import HoldoutOptions, within
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.estimation.refit import refit
from gravity_comp_ros.estimation.refit_result import Refit
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.history import with_step
from gravity_comp_ros.models.provenance import held_out_blocks
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions, ReadReport
from gravity_comp_ros.workbench.choice import Choice

Progress = Callable[[str, float], None]
# What `fit --holdout` held out stays so with its margins, s, as `add` does it.
_GUARD = HoldoutOptions().guard


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
class Learned:
    """The model, and its held-out RMSE by joint in N·m (empty where it has no energy)."""

    model: GravityModel
    held_out: dict[str, float]
    warnings: tuple[str, ...]


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


@dataclass(frozen=True)
class Added:
    """The model with the effects, its history one step longer, and how the refit went."""

    model: GravityModel
    result: Refit


Job = Read | Learn | Ask | Add
Answer = WasRead | Learned | Diagnosis | Added


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
        samples = job.choice.chosen(self._read.samples)
        reports = tuple(self._read.reports[run] for run in job.choice.runs)
        if isinstance(job, Learn):
            return learn(samples, reports, job.choice, progress)
        if isinstance(job, Ask):
            return diagnose(samples, job.model, progress=progress)
        return add(samples, reports, job, progress)

    def _reading(self, job: Read, progress: Progress) -> WasRead:
        found = []
        for number, path in enumerate(job.paths):
            progress(f'read {path.name}', number / len(job.paths))
            try:
                found.append(read_bag(path, job.options))
            except ModelMismatchError as problem:
                if not job.model:
                    raise
                raise ModelMismatchError(f'the model {job.model} is of another robot: {problem}'
                                         ) from problem
        self._read = WasRead(concatenate(r.samples for r in found),
                             tuple(r.report for r in found))
        return self._read


def learn(samples: JointSamples, reports: tuple[ReadReport, ...], choice: Choice,
          progress: Progress) -> Learned:
    """Return the model that `gravity_comp fit` gives, and its held-out error."""
    gated = choice.gated(samples)
    result = fit(gated.samples, FitOptions(formulation=choice.formulation), progress)
    held_out: dict[str, float] = {}
    if result.model.energy is not None:
        progress('held-out error', 0.8)
        # A refit without anything new: only its held-out error is wanted.
        held_out = refit(samples, result.model, [], choice.refit_options()).by_joint()[0]
    provenance = {**result.model.provenance, 'bags': [report.to_json() for report in reports],
                  'gate': gated.to_json(), 'holdout': None}
    return Learned(replace(result.model, provenance=provenance), held_out,
                   tuple(result.report['warnings']))


def add(samples: JointSamples, reports: tuple[ReadReport, ...], job: Add,
        progress: Progress) -> Added:
    """Return the model with effects that `gravity_comp add` gives."""
    wanted = requests(job.effects, job.model.joints)
    held = held_out_blocks(job.model, [report.sha256 for report in reports], _GUARD)
    result = refit(samples, job.model, wanted, job.choice.refit_options(),
                   ~within(samples, held), progress)
    model = with_step(result.model, job.model, result.added, now(), *result.by_joint())
    known = list(job.model.provenance.get('bags', ()))
    seen = {bag['sha256'] for bag in known}
    new = [report.to_json() for report in reports if report.sha256 not in seen]
    model = replace(model, provenance={**job.model.provenance, 'bags': [*known, *new]})
    # The history holds every earlier model; what travels back need not hold it twice.
    return Added(model, replace(result, model=model))


def now() -> str:
    """Return the time, for histories and file names."""
    return datetime.now(UTC).isoformat(timespec='seconds')


def described(job: Job) -> str:
    """Return what is being done, in words."""
    words: dict[type[Any], str] = {Read: 'Reading', Learn: 'Learning gravity',
                                   Ask: 'Looking for what is missing'}
    return f'Adding {", ".join(job.effects)}' if isinstance(job, Add) else words[type(job)]
