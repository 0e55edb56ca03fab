"""
Jobs of the workbench and their answers, run in a separate process.

The page stays responsive, and can cancel a job. The process starts with the first job and runs one
at a time. Cancelling kills it; the next job starts a new one, which reads the recordings again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from gravity_comp_ros.api.axes import ArmOptions, ASKED, known_arm
from gravity_comp_ros.api.read import arm_facts, check_facts, read_each
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import add_to_model, diagnose_recording, learn, Learned
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import ModelMismatchError
from gravity_comp_ros.estimation.refit import Refit
from gravity_comp_ros.facts.fact import Fact
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.collision import arm_limits
from gravity_comp_ros.planning.expected import MotionPlan
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.recordings.bag import ReadReport
from gravity_comp_ros.workbench.stages import Choice
from gravity_comp_ros.worker.serve import ProgressCallback
from gravity_comp_ros.worker.worker_process import command, Worker
import numpy as np


@dataclass(frozen=True)
class ReadResult:
    """
    All samples, a report on each recording, and the `arm_facts` of all together.

    Without selected joints they are those of the arm, in its order; others are `left_out`.
    """

    samples: JointSamples
    reports: tuple[ReadReport, ...]
    facts: tuple[Fact, ...] = ()
    left_out: tuple[str, ...] = ()


class Step(StrEnum):
    """Kinds of jobs, as the page describes a running one."""

    READ = 'Reading'
    LEARN = 'Learning gravity'
    DIAGNOSE = 'Diagnosing'
    ADD = 'Adding'
    PLAN = 'Planning the next recording'


@dataclass(frozen=True)
class Job:
    """
    A step, all recordings, and the choice among them; the last steps have a model.

    `ordered` tells whether the joints were given in the order of the arm. `given` is the name of
    the model that determines the joints, if any. `effects` are those to add, in the notation of
    `gravity_comp add`, or those that a planned motion resolves (None: all open findings of the
    `diagnosis`).
    """

    step: Step
    paths: tuple[Path, ...]
    choice: Choice
    ordered: bool = False
    given: str = ''
    model: GravityModel | None = None
    effects: tuple[str, ...] | None = None
    diagnosis: Diagnosis | None = None

    def __str__(self) -> str:
        return ' '.join([self.step, *[', '.join(self.effects or ())] * (self.step is Step.ADD)])

    @property
    def samples_key(self) -> tuple[object, ...]:
        """Return the identity of the samples, up to the order of the joints."""
        return self.paths, frozenset(self.choice.joints), self.choice.reading

    def of_joints(self, names: tuple[str, ...]) -> Job:
        """Return the job with these joints."""
        return replace(self, choice=replace(self.choice, joints=names))


Answer = ReadResult | Learned | Diagnosis | Refit | MotionPlan


class JobRunner:
    """Runs jobs; keeps the samples between them, and reads them if it does not have them."""

    def __init__(self) -> None:
        self._known: tuple[tuple[object, ...], ReadResult] | None = None

    def __call__(self, job: Job, progress: ProgressCallback) -> Answer:
        """
        Return the answer to a job.

        :raises GravityCompError: if it fails, with the reason in one line.
        """
        read = self._samples(job, progress)
        if job.step is Step.READ:
            return read
        recording = job.choice.recording(read.samples, read.reports)
        for report in recording.reports:
            check_facts(report.facts, where=report.path.name)
        model = job.model
        if model is None:
            return _learned(recording, job, progress)
        if job.step is Step.PLAN:
            limits = arm_limits(job.choice.urdf, job.paths, model.joints,
                                recording.samples.joints(model.joints).q)
            planned = plan(recording.samples, model, job.effects, diagnosis=job.diagnosis,
                           progress=progress, obstacles=limits.check)
            return replace(planned, notes=(*planned.notes, limits.note))
        if job.step is Step.DIAGNOSE:
            return diagnose_recording(recording, model, progress=progress).diagnosis
        return add_to_model(model, recording, job.effects or (), progress)

    def _samples(self, job: Job, progress: ProgressCallback) -> ReadResult:
        if self._known is not None and job.samples_key == self._known[0]:
            return self._known[1]
        try:
            result = _read(job, progress)
        except ModelMismatchError as problem:
            if not job.given:
                raise
            raise ModelMismatchError(f'the model {job.given} is of another robot: {problem}'
                                     ) from problem
        self._known = job.of_joints(result.samples.names).samples_key, result
        return result


def _read(job: Job, progress: ProgressCallback) -> ReadResult:
    recordings = read_each(job.paths, job.choice.options(), progress)
    samples = concatenate(recording.samples for recording in recordings)
    reports = tuple(recording.report for recording in recordings)
    recording = Recording(samples, None, reports)
    arm = known_arm(recording, ArmOptions(urdf=job.choice.description, ordered=job.ordered))
    left_out = () if job.choice.joints else arm.left_out
    if left_out:
        # Read again without other joints, whose missing values would drop messages.
        return replace(_read(job.of_joints(arm.order.joints), progress), left_out=left_out)
    return ReadResult(samples if job.choice.joints else samples.joints(arm.order.joints),
                      reports, arm_facts(recording, arm, refuse=False))


def _learned(recording: Recording, job: Job, progress: ProgressCallback) -> Learned:
    """Return the result of `gravity_comp fit --joints`."""
    result = learn(recording, job.choice.learning(job.ordered), progress=progress)
    # The page already has the samples.
    none = recording.samples.select(np.zeros(0, dtype=np.int64))
    result = replace(result, recording=replace(recording, samples=none))
    if result.arm.geometry is not None:
        return result
    # The exported command lines list the joints in this order.
    provenance = {**result.model.provenance, 'joint_order': ASKED}
    return replace(result, result=replace(
        result.result, model=replace(result.model, provenance=provenance)))


def new_worker() -> Worker:
    """Return a worker for the jobs of a session."""
    return Worker(command(f'{__name__}:{JobRunner.__name__}', 5))
