"""What workers do: read a bag, fit a robot, diagnose a robot. They write nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from gravity_comp_ros.api.learn import learn, LearnOptions, model_of
from gravity_comp_ros.api.read import gated_recording
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.diagnosis.diagnose import diagnose, DiagnosisOptions
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import BagError, FitError, GravityCompError
from gravity_comp_ros.estimation.fit import FitResult
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.gated_bag import GatedRecording, read_gated


@dataclass(frozen=True)
class ReadTask:
    """A bag to be read and gated."""

    bag: Path
    options: ReadOptions
    gate: GateOptions


@dataclass(frozen=True)
class FitTask:
    """What was read of one robot's bags with a gate, to be fitted."""

    found: tuple[GatedRecording, ...]
    gate: GateOptions
    options: LearnOptions


@dataclass(frozen=True)
class DiagnoseTask:
    """The bags of one robot, to be diagnosed beside a model, or beside one fitted on the spot."""

    bags: tuple[Path, ...]
    options: ReadOptions
    model: GravityModel | None
    effects: tuple[str, ...] | None


def read(task: ReadTask) -> GatedRecording:
    """
    Return the slow samples of a bag.

    :raises BagError: if it cannot be read or nothing in it is slow.
    """
    found = read_gated(task.bag, task.options, task.gate)
    if not found.samples.n_samples:
        raise BagError(f'{task.bag}: none of {found.report.n_samples} samples is slow')
    return found


def fit_robot(task: FitTask) -> FitResult:
    """
    Return the fit of one robot.

    :raises FitError: if its samples do not do.
    """
    if not task.found:
        raise FitError('none of its bags could be read')
    recording = gated_recording(task.found, task.gate)
    learned = learn(recording, task.options)
    problem = learned.arm.axes.problem
    return learned.result.warned(problem) if problem else learned.result


def diagnose_robot(task: DiagnoseTask) -> tuple[Diagnosis, dict[str, str]]:
    """
    Return the diagnosis of one robot, and why bags were left out.

    :raises FitError: if none of its bags can be read.
    """
    options, parts, failed = task.options, [], {}
    if task.model is not None and options.joints is None:
        options = replace(options, joints=task.model.joints)
    for bag in task.bags:
        try:
            parts.append(read_bag(bag, options))
        except GravityCompError as error:
            failed[str(bag)] = str(error)
    if not parts:
        raise FitError(f'none of its bags could be read: {"; ".join(failed.values())}')
    recording = Recording(concatenate(part.samples for part in parts), None,
                          tuple(part.report for part in parts))
    how = LearnOptions(ordered=options.joints is not None)
    model = task.model or model_of(recording, how)
    return diagnose(recording.samples, model, DiagnosisOptions(effects=task.effects)), failed
