"""Contents of a report, the data of its plots, and limits of what it draws and names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from bokeh.models import ColumnDataSource, Span
from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.evaluation.compare import COMPARISON, Comparison
from gravity_comp_ros.facts.motion import describe, RecordingFacts
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.history import now
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.recordings.bag import ReadReport
from gravity_comp_ros.report.style import padded, PURPLE
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ReportOptions:
    """
    Limits of what the report draws and names.

    - `worse`: ratio of an error to the training error beyond statistical uncertainty;
      `larger`: ratio to the median error of the other joints, or of a useless model to its
      training error, that is reported. `max_regions`: of large error, by joint.
    - `max_rows`: samples that are drawn, approximately; a page of them is still quick.
    - `break_steps`: minimum gap that breaks a line, in median steps.
    - `max_order`, cycles per revolution, and `order_step`, cycles over the visited range: of a
      spectrum over the angle; `min_travel`, rad: of a joint for one.
    - `max_plots`: added-variable plots.
    - `shown_terms`: of the model's terms in the equation.

    :raises OptionError: if a number is not positive.
    """

    worse: float = 2.0
    larger: float = 3.0
    max_regions: int = 2
    max_rows: int = 12_000
    break_steps: float = 20.0
    max_order: float = 80.0
    order_step: float = 0.5
    min_travel: float = 0.05
    max_plots: int = 9
    shown_terms: int = 8

    def __post_init__(self) -> None:
        check_positive(self, 'report')


REPORT = ReportOptions()


@dataclass(frozen=True)
class Contents:
    """
    Samples, model, comparison and diagnosis.

    `samples` are all recorded samples of the model's joints. `comparison` may use a part of them
    (slow motion), described by `compared`. `command`, `when`, `model_file` (None without a file)
    and `notes` are the origin of the report. `previous` has the RMSE by joint in N·m of another
    model, `previous_name`, on the same part. `displayed` are the joints of the report, all if
    empty. `next_command` is the command line of the next step, if any. `arm` requires a robot
    description.
    """

    samples: JointSamples
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
    arm: Geometry | None = None

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the joints to show."""
        return self.displayed or self.model.joints

    @property
    def numbers(self) -> list[int]:
        """Return the indices of the shown joints among the model's."""
        return [self.model.joints.index(name) for name in self.joints]

    @cached_property
    def predicted(self) -> FloatArray:
        """Return the torque of the model (M, N) in N·m for all samples."""
        return predict_torque(self.model, self.samples)

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


class Table:
    """
    Decimated samples for all plots, with breaks between runs and in long gaps.

    Columns, for the model's joint n: `q{n}` rad, `v{n}` rad/s, `m{n}`, `p{n}` and `r{n}` N·m
    (measured, predicted, residual), `d{n}` the direction of motion as -1, 0, 1; `t` in s with
    runs one after another. `rows` (R,) are sample indices, -1 for a break. `range` is the common
    range of plots over time; `cursor` marks the time of the drawn pose.
    """

    def __init__(self, contents: Contents) -> None:
        samples = contents.samples
        self.contents = contents
        time, self.starts = _plot_time(samples)
        self.end = float(time.max())
        kept = keep_extremes(samples.runs, np.hstack([samples.tau, contents.residual]))
        breaks = _breaks(contents, kept)
        self.rows = np.insert(kept, breaks, -1)
        self.range = padded(0.0, self.end, 0.01)
        self.cursor = Span(dimension='height', visible=False, line_width=1.5, line_color=PURPLE)
        data: dict[str, NDArray[Any]] = {'t': self.column(time)}
        for n in contents.numbers:
            speed = samples.qd[:, n]
            direction = np.where(np.abs(speed) <= COMPARISON.rest_speed, 0.0, np.sign(speed))
            data |= {f'q{n}': self.column(samples.q[:, n]), f'v{n}': self.column(speed),
                     f'd{n}': self.column(direction), f'm{n}': self.column(samples.tau[:, n]),
                     f'p{n}': self.column(contents.predicted[:, n]),
                     f'r{n}': self.column(contents.residual[:, n])}
        self.source = ColumnDataSource(data, name='samples')

    @property
    def drawn(self) -> IntArray:
        """Return the drawn sample indices without breaks."""
        return self.rows[self.rows >= 0]

    def column(self, values: NDArray[Any]) -> NDArray[np.float32]:
        """Return values of all samples (M,) at the drawn rows; NaN at breaks."""
        return self.spread(values[self.drawn])

    def spread(self, values: NDArray[Any]) -> NDArray[np.float32]:
        """Return a column of values of the drawn samples; NaN at breaks."""
        column = np.full(len(self.rows), np.nan, dtype=np.float32)
        column[self.rows >= 0] = values
        return column

    def add(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """Add columns."""
        self.source.data.update(columns)


def _plot_time(samples: JointSamples) -> tuple[FloatArray, list[tuple[float, str]]]:
    """Return time for plots (M,) in s, runs one after another, and start and name of each run."""
    time = np.array(samples.t, dtype=np.float64)
    runs = [np.flatnonzero(samples.runs == run) for run in np.unique(samples.runs)]
    gap = 0.01 * sum(float(np.ptp(time[rows])) for rows in runs)
    starts, offset = [], 0.0
    for rows in runs:
        time[rows] += offset - time[rows[0]]
        starts.append((offset, samples.run_labels[samples.runs[rows[0]]]))
        offset = float(time[rows[-1]]) + gap
    return time, starts


def _breaks(contents: Contents, rows: IntArray) -> IntArray:
    samples = contents.samples
    new_run = np.diff(samples.runs[rows]) > 0
    steps = np.diff(samples.t)
    median = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    # Gaps of the recording, not gaps from decimation.
    gaps = np.flatnonzero(steps > REPORT.break_steps * median)
    gap = np.diff(np.searchsorted(gaps, rows)) > 0
    return np.flatnonzero(new_run | gap) + 1


def keep_extremes(runs: IntArray, values: FloatArray,
                  max_rows: int = REPORT.max_rows) -> IntArray:
    """
    Return increasing sample indices, about `max_rows` of M.

    Time is divided into intervals. The minimum and maximum of every column in each interval are
    kept, and so are the first and last samples of runs; equidistant samples fill the rest.

    :param runs: the run of each sample (M,).
    :param values: the drawn values (M, K).
    """
    m, k = values.shape
    if m <= max_rows:
        return np.arange(m, dtype=np.int64)
    kept = [np.searchsorted(runs, np.unique(runs)),
            np.searchsorted(runs, np.unique(runs), side='right') - 1]
    edges = np.linspace(0, m, max(1, max_rows // (4 * k)) + 1).astype(np.int64)
    for first, last in zip(edges[:-1], edges[1:]):
        part = values[first:last]
        kept += [first + part.argmin(axis=0), first + part.argmax(axis=0)]
    extremes = np.unique(np.concatenate(kept))
    filling = np.linspace(0, m - 1, max(max_rows - len(extremes), 2)).astype(np.int64)
    return np.union1d(extremes, filling).astype(np.int64)
