"""
Jobs of the workbench and their answers, run in a separate process.

The page stays responsive, and can cancel a job. The process starts with the first job and runs one
at a time. Cancelling kills it; the next job starts a new one, which reads the recordings again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gravity_comp_ros.api.arm_facts import arm_facts, check_facts, model_facts
from gravity_comp_ros.api.axes import AxesOptions
from gravity_comp_ros.api.learn import ASKED, known_arm, KnownArm, learn, Learned, LearnOptions
from gravity_comp_ros.api.read import read_each
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import add_to_model
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import ModelMismatchError
from gravity_comp_ros.estimation.refit import Refit, RefitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.expected import MotionPlan
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.planning.questions import named_targets
from gravity_comp_ros.recordings.bag import ReadOptions, ReadReport, Recording as BagRecording
from gravity_comp_ros.workbench.stages import Choice
from gravity_comp_ros.worker.serve import ProgressCallback, Work
from gravity_comp_ros.worker.worker_process import (
    command, Done, Failed as NotDone, Lost, Progress, WorkerProcess)
import numpy as np


@dataclass(frozen=True)
class Read:
    """
    Read recordings; the process keeps the samples for later jobs.

    `model` is the name of the model that determines the joints, if any. `urdf` is as in `Choice`.
    `ordered` tells whether the joints were given in the order of the arm.
    """

    paths: tuple[Path, ...]
    options: ReadOptions
    model: str = ''
    urdf: str | None = None
    ordered: bool = False

    def gives_same_samples(self, other: Read | None) -> bool:
        """Return whether another reading gives the same samples, up to the order of joints."""
        if other is None or self.paths != other.paths or (
                self.options.joints is None) != (other.options.joints is None):
            return False
        return set(self.options.joints or ()) == set(other.options.joints or ()) \
            and replace(self.options, joints=None) == replace(other.options, joints=None)

    def of_joints(self, names: tuple[str, ...]) -> Read:
        """Return the reading that selects these joints."""
        return replace(self, options=replace(self.options, joints=names))


@dataclass(frozen=True)
class ReadResult:
    """
    All samples, and a report on each recording.

    Without selected joints they are those of the arm, in its order; others are `left_out`.
    """

    samples: JointSamples
    reports: tuple[ReadReport, ...]
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True)
class Learn:
    """
    Fit gravity to the chosen samples.

    `ordered` tells whether the joints are given in the order of the arm.
    """

    read: Read
    choice: Choice
    ordered: bool = True


@dataclass(frozen=True)
class Diagnose:
    """Diagnose the chosen runs with a model."""

    read: Read
    choice: Choice
    model: GravityModel


@dataclass(frozen=True)
class Add:
    """Add effects, in the notation of `gravity_comp add`, and refit."""

    read: Read
    choice: Choice
    model: GravityModel
    effects: tuple[str, ...]


@dataclass(frozen=True)
class PlanMotion:
    """Plan a motion that resolves effects, or all open findings of a diagnosis (None)."""

    read: Read
    choice: Choice
    model: GravityModel
    diagnosis: Diagnosis | None
    effects: tuple[str, ...] | None = None


Job = Read | Learn | Diagnose | Add | PlanMotion
Answer = ReadResult | Learned | Diagnosis | Refit | MotionPlan


class JobRunner:
    """Runs jobs; keeps the samples between them, and reads them if it does not have them."""

    def __init__(self) -> None:
        self._known: tuple[Read, ReadResult] | None = None

    def work(self, job: Job, progress: ProgressCallback) -> Answer:
        """
        Return the answer to a job.

        :raises GravityCompError: if it fails, with the reason in one line.
        """
        read = self._samples(job if isinstance(job, Read) else job.read, progress)
        if isinstance(job, Read):
            return read
        recording = job.choice.recording(read.samples, read.reports)
        for report in recording.reports:
            check_facts(report.facts, where=report.path.name)
        if isinstance(job, (Diagnose, Add)):
            check_facts(model_facts(recording, job.read.options, job.model))
        if isinstance(job, Learn):
            return _learned(recording, job, progress)
        if isinstance(job, Diagnose):
            return diagnose(recording.samples, job.model, progress=progress)
        if isinstance(job, PlanMotion):
            targets = None if job.effects is None else named_targets(job.effects,
                                                                     job.model.joints)
            return plan(recording.samples, job.model, targets, diagnosis=job.diagnosis,
                        progress=progress)
        speeds = RefitOptions.chosen(job.choice.all_samples, job.choice.max_speed)
        return add_to_model(job.model, recording, job.effects, speeds, progress)

    def _samples(self, job: Read, progress: ProgressCallback) -> ReadResult:
        if self._known is not None and job.gives_same_samples(self._known[0]):
            return self._known[1]
        try:
            result = _read(job, progress)
        except ModelMismatchError as problem:
            if not job.model:
                raise
            raise ModelMismatchError(f'the model {job.model} is of another robot: {problem}'
                                     ) from problem
        self._known = job.of_joints(result.samples.names), result
        return result


def _read(job: Read, progress: ProgressCallback) -> ReadResult:
    recordings = read_each(job.paths, job.options, progress)
    samples = concatenate(recording.samples for recording in recordings)
    reports = tuple(recording.report for recording in recordings)
    arm = known_arm(Recording(samples, None, reports),
                    LearnOptions(axes=AxesOptions(job.urdf), ordered=job.ordered))
    if job.options.joints is not None:
        return ReadResult(samples, _judged(recordings, arm, job.options))
    left_out = arm.axes.left_out
    if left_out:
        # Read again without other joints, whose missing values would drop messages.
        return replace(_read(job.of_joints(arm.order.joints), progress), left_out=left_out)
    return ReadResult(samples.joints(arm.order.joints), _judged(recordings, arm, job.options))


def _judged(recordings: Sequence[BagRecording], arm: KnownArm,
            options: ReadOptions) -> tuple[ReadReport, ...]:
    """Return the reports with the facts on the joints against each other."""
    reports = []
    for each in recordings:
        facts = arm_facts(Recording(each.samples, None, (each.report,)), arm, options)
        reports.append(replace(each.report, facts=(*each.report.facts, *facts)))
    return tuple(reports)


def _learned(recording: Recording, job: Learn, progress: ProgressCallback) -> Learned:
    """Return the result of `gravity_comp fit --joints`."""
    result = learn(recording, job.choice.learning(job.ordered), progress=progress)
    # The page already has the samples.
    none = recording.samples.select(np.zeros(0, dtype=np.int64))
    result = replace(result, recording=replace(recording, samples=none))
    if result.arm.axes.geometry is not None:
        return result
    # The exported command lines list the joints in this order.
    provenance = {**result.model.provenance, 'joint_order': ASKED}
    return replace(result, result=replace(
        result.result, model=replace(result.model, provenance=provenance)))


def described(job: Job) -> str:
    """Return a description of a running job."""
    names: dict[type[Any], str] = {Read: 'Reading', Learn: 'Learning gravity',
                                   Diagnose: 'Diagnosing',
                                   PlanMotion: 'Planning the next recording'}
    return f'Adding {", ".join(job.effects)}' if isinstance(job, Add) else names[type(job)]


PROCESS_ENDED = 'the worker process ended unexpectedly (out of memory?)'
_NICENESS = 5


@dataclass(frozen=True)
class Finished:
    """A job and its answer."""

    job: Job
    answer: Answer


@dataclass(frozen=True)
class Failed:
    """A job without an answer, and the reason in one line."""

    job: Job
    reason: str


Event = Progress | Finished | Failed


def job_runner() -> Work:
    """Return a function that runs jobs and keeps the recordings between them."""
    return JobRunner().work


class Worker:
    """Runs jobs in a separate process; no method blocks."""

    def __init__(self) -> None:
        self.job: Job | None = None
        self._process = WorkerProcess(command(f'{__name__}:{job_runner.__name__}', _NICENESS))
        self._failed: list[Event] = []

    @property
    def pid(self) -> int | None:
        """The process id; None without a process."""
        return self._process.pid

    def start(self, job: Job) -> None:
        """Start a job; `poll` returns its events."""
        self.job = job
        try:
            if self.pid is None:
                self._process.start()
        except OSError as problem:
            # Not enough memory, or too many processes.
            self.job, reason = None, problem.strerror or 'unknown'
            self._failed.append(Failed(job, f'no worker process can be started: {reason}'))
            return
        self._process.send(job)

    def cancel(self) -> None:
        """End the running job without an event."""
        if self.job is not None:
            self.rest()

    def rest(self) -> None:
        """End the process; the next job starts a new one."""
        self.job, self._failed = None, []
        self._process.end()

    def poll(self) -> list[Event]:
        """Return the events since the last call."""
        events, self._failed = self._failed, []
        for message in self._process.messages():
            job = self.job
            if isinstance(message, Progress):
                events.append(message)
            elif job is not None and isinstance(message, (Done, NotDone, Lost)):
                self.job = None
                events.append(Finished(job, message.answer) if isinstance(message, Done) else
                              Failed(job, message.reason if isinstance(message, NotDone)
                                     else PROCESS_ENDED))
        return events
