"""Contents of a report: samples, predictions, comparison and diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from gravity_comp_ros.api.provenance import now
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.evaluation.compare import Comparison
from gravity_comp_ros.facts.motion import describe, RecordingFacts
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.recordings.bag import ReadReport
import numpy as np

if TYPE_CHECKING:
    from gravity_comp_ros.report.views.arm import Arm


@dataclass(frozen=True)
class Contents:
    """
    Samples, predictions of the model, comparison and diagnosis.

    `samples` are all recorded samples of the model's joints; `predicted` (M, N) is their torque
    in N·m. `comparison` may use a part of them (slow motion), described by `compared`. `command`,
    `when`, `model_file` (None without a file) and `notes` are the origin of the report. `previous`
    has the RMSE by joint in N·m of another model, `previous_name`, on the same part. `displayed`
    are the joints of the report, all if empty. `next_command` is the command line of the next
    step, if any. `arm` requires a robot description.
    """

    samples: JointSamples
    predicted: FloatArray
    model: GravityModel
    comparison: Comparison
    compared: str
    reports: tuple[ReadReport, ...]
    command: str
    when: str = field(default_factory=now)
    model_file: str | None = None
    notes: tuple[str, ...] = ()
    diagnosis: Diagnosis | None = None
    previous: Mapping[str, float] = field(default_factory=dict)
    previous_name: str = ''
    displayed: tuple[str, ...] = ()
    next_command: str = ''
    arm: Arm | None = None

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the joints to show."""
        return self.displayed or self.model.joints

    @property
    def numbers(self) -> list[int]:
        """Return the indices of the shown joints among the model's."""
        return [self.model.joints.index(name) for name in self.joints]

    @cached_property
    def residual(self) -> FloatArray:
        """Return measured minus predicted torque (M, N) in N·m."""
        return np.asarray(self.samples.tau - self.predicted)

    @cached_property
    def facts(self) -> RecordingFacts:
        """Return the facts of the recording."""
        return describe(self.samples)

    def error(self, name: str) -> str:
        """Return the RMSE of a joint in N·m, as every part of the page shows it."""
        return f'{self.comparison.joints[name].rmse:.4f}'

    @property
    def worst(self) -> str:
        """Return the shown joint with the largest RMSE."""
        return max(self.joints, key=lambda name: self.comparison.joints[name].rmse)
