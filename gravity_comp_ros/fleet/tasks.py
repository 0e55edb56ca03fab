"""Tasks of the workers, without output files: read a bag, fit a robot, diagnose a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gravity_comp_ros.api.learn import learn, learn_gravity, LearnOptions
from gravity_comp_ros.api.read import bounded, gated_recording
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


def read(bag: Path, options: ReadOptions, gate: GateOptions) -> GatedRecording:
    """
    Return the slow samples of a bag.

    :raises BagError: if it cannot be read or has no slow samples.
    """
    recording = read_gated(bag, bounded(options, 1), gate)
    if not recording.samples.n_samples:
        raise BagError(f'{bag}: none of {recording.report.n_samples} samples is slow')
    return recording


def fit_robot(runs: Sequence[GatedRecording], gate: GateOptions,
              options: LearnOptions) -> FitResult:
    """
    Return the fit of one robot to the slow samples of its bags.

    :raises FitError: if there are none, or too few.
    """
    if not runs:
        raise FitError('none of its bags could be read')
    learned = learn(gated_recording(runs, gate), options)
    problem = learned.arm.axes.problem
    return learned.result.with_warning(problem) if problem else learned.result


def diagnose_robot(robot: tuple[Sequence[Path], GravityModel | None], options: ReadOptions,
                   effects: tuple[str, ...] | None) -> tuple[Diagnosis, dict[str, str]]:
    """
    Return the diagnosis of one robot, and the reasons of unreadable bags.

    :param robot: its bags, and the model to diagnose; None fits a model first.
    :raises FitError: if none of its bags can be read.
    """
    (bags, model), runs, failed = robot, [], {}
    if model is not None and options.joints is None:
        options = replace(options, joints=model.joints)
    for bag in bags:
        try:
            runs.append(read_bag(bag, options))
        except GravityCompError as error:
            failed[str(bag)] = str(error)
    if not runs:
        raise FitError(f'none of its bags could be read: {"; ".join(failed.values())}')
    recording = Recording(concatenate(run.samples for run in runs), None,
                          tuple(run.report for run in runs))
    model = model or learn_gravity(recording, LearnOptions(ordered=options.joints is not None))
    return diagnose(recording.samples, model, DiagnosisOptions(effects=effects)), failed
