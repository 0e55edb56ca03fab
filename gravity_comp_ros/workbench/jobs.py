"""The long work of the workbench, done by a process of its own: what is asked, and answered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime, UTC
from pathlib import Path
from typing import Any

from gravity_comp_ros.data.gate import slow_samples
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
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions, ReadReport
import numpy as np

# So many samples are refitted in a second or two.
_MANY = 30000
_SLOWEST = 0.04

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
class Choice:
    """Which runs (by number) and joints to work with."""

    runs: tuple[int, ...]
    joints: tuple[str, ...]


@dataclass(frozen=True)
class Learn:
    """Fit gravity to the slow samples of the chosen runs."""

    choice: Choice
    formulation: str


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
        samples = self._chosen(job.choice)
        if isinstance(job, Learn):
            return learn(samples, job.formulation, progress)
        if isinstance(job, Ask):
            return diagnose(thinned(samples), job.model, progress=progress)
        return add(thinned(samples), job, progress)

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

    def _chosen(self, choice: Choice) -> JointSamples:
        if self._read is None:
            raise DataError('no recording has been read')
        return chosen(self._read.samples, choice)


def chosen(samples: JointSamples, choice: Choice) -> JointSamples:
    """
    Return the samples of the chosen runs and joints.

    :raises DataError: if no run is chosen.
    """
    runs = [samples.run(number) for number in choice.runs]
    if not runs:
        raise DataError('no run is chosen')
    return concatenate(runs).joints(choice.joints)


def thinned(samples: JointSamples) -> JointSamples:
    """
    Return fewer samples of a long recording, at even distances, so that nobody waits long.

    Not less than 25 a second stay, which accelerations need.
    """
    steps = np.diff(samples.t)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 1.0
    every = min(-(-samples.n_samples // _MANY), max(1, round(_SLOWEST / usual)))
    return samples.select(np.arange(samples.n_samples) % every == 0) if every > 1 else samples


def slow_part(samples: JointSamples) -> JointSamples:
    """
    Return the samples that gravity is learned from and judged on.

    :raises DataError: if none is slow.
    """
    gate = slow_samples(samples)
    if not gate.kept:
        raise DataError('no sample is slow (every joint under 0.15 rad/s): record slow motion')
    return gate.samples


def learn(samples: JointSamples, formulation: str, progress: Progress) -> Learned:
    """Return a model of the samples' slow part, and its held-out error."""
    result = fit(slow_part(samples), FitOptions(formulation=formulation), progress)
    held_out: dict[str, float] = {}
    if result.model.energy is not None:
        progress('held-out error', 0.8)
        # A refit without anything new: only its held-out error is wanted.
        held_out = refit(samples, result.model, []).by_joint()[0]
    return Learned(result.model, held_out, tuple(result.report['warnings']))


def add(samples: JointSamples, job: Add, progress: Progress) -> Added:
    """Return the model with effects."""
    wanted = requests(job.effects, job.model.joints)
    result = refit(samples, job.model, wanted, progress=progress)
    model = with_step(result.model, job.model, result.added, now(), *result.by_joint())
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
