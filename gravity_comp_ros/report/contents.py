"""What a report tells of, gathered before anything is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.evaluation.compare import Comparison
from gravity_comp_ros.evaluation.recording_quality import describe, RecordingFacts
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.recordings.bag import ReadReport
from gravity_comp_ros.report.arm import Arm
import numpy as np

# Speeds below this are rest, for the colour of a point.
STILL = 1e-3


@dataclass(frozen=True)
class Origin:
    """Where a report comes from: the command, when, and the model's file name if it has one."""

    command: str
    when: str
    model_file: str | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Contents:
    """
    Samples, the model's prediction of them, and what was found.

    `samples` are all that was recorded, of the model's joints; `predicted` (M, N) in N·m
    belongs to them. `comparison` may be of a part of them (slow motion), which `judged` (a
    sentence) tells. `previous` holds the RMSE by joint in N·m of another model on the same
    part, named `previous_name`. `diagnosis` is None where none was made.
    `next_command` is the command line that goes on from here, if there is one; `arm` is there
    where a robot description is.
    """

    samples: JointSamples
    predicted: FloatArray
    model: GravityModel
    comparison: Comparison
    judged: str
    reports: tuple[ReadReport, ...]
    origin: Origin
    diagnosis: Diagnosis | None = None
    previous: Mapping[str, float] = field(default_factory=dict)
    previous_name: str = ''
    shown: tuple[str, ...] = ()
    next_command: str = ''
    arm: Arm | None = None

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the joints to show, all of the model unless chosen otherwise."""
        return self.shown or self.model.joints

    @property
    def numbers(self) -> list[int]:
        """Return the places of the shown joints among the model's."""
        return [self.model.joints.index(name) for name in self.joints]

    @cached_property
    def residual(self) -> FloatArray:
        """Return measured minus predicted torque (M, N) in N·m."""
        return np.asarray(self.samples.tau - self.predicted)

    @cached_property
    def extent(self) -> FloatArray:
        """Return what is drawn over time (M, 2 N) in N·m, whose extremes are always kept."""
        return np.hstack([self.samples.tau, self.residual])

    @cached_property
    def facts(self) -> RecordingFacts:
        """Return what the recording holds."""
        return describe(self.samples)

    @cached_property
    def outside(self) -> BoolArray:
        """Return which poses (M,) lie outside the trained range."""
        return np.asarray(self.model.coverage.distance(self.samples.q).max(axis=1) > 0.0)

    @property
    def worst(self) -> str:
        """Return the shown joint with the largest RMSE."""
        return max(self.joints, key=lambda name: self.comparison.joints[name].rmse)


def plot_time(samples: JointSamples) -> tuple[FloatArray, list[tuple[float, str]]]:
    """Return time for plots (M,), runs one after another, and where each run begins."""
    time = np.asarray(samples.t, dtype=np.float64).copy()
    starts: list[tuple[float, str]] = []
    offset, total = 0.0, 0.0
    for run in np.unique(samples.runs):
        here = samples.runs == run
        total += float(np.ptp(samples.t[here]))
    gap = 0.01 * total
    for run in np.unique(samples.runs):
        here = samples.runs == run
        time[here] += offset - samples.t[here][0]
        starts.append((offset, samples.run_labels[run]))
        offset = float(time[here][-1]) + gap
    return time, starts
