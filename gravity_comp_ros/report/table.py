"""Data table shared by all plots, so that a selection in one is marked in all."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bokeh.models import ColumnDataSource, Span
from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.evaluation.compare import REGIONS
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.options import REPORT
from gravity_comp_ros.report.style import padded, PURPLE
import numpy as np
from numpy.typing import NDArray


class Table:
    """
    Decimated samples for all plots, with breaks between runs and in long gaps.

    Columns, for the model's joint n: `q{n}` rad, `v{n}` rad/s, `m{n}`, `p{n}` and `r{n}` N·m
    (measured, predicted, residual), `d{n}` the direction of motion as -1, 0, 1; `t` in s with
    runs one after another; `w` the number of samples that a row represents. `rows` (R,) are
    sample indices, -1 for a break. `range` is the common range of plots over time; `cursor` marks
    the time of the drawn pose.
    """

    def __init__(self, contents: Contents) -> None:
        samples = contents.samples
        self.contents = contents
        time, self.starts = _plot_time(samples)
        self.end = float(time.max())
        kept, weights = keep_extremes(samples.runs, np.hstack([samples.tau, contents.residual]))
        breaks = _breaks(contents, kept)
        self.rows = np.insert(kept, breaks, -1)
        self.range = padded(0.0, self.end, 0.01)
        self.cursor = Span(dimension='height', visible=False, line_width=1.5, line_color=PURPLE)
        data: dict[str, NDArray[Any]] = {
            't': self.column(time), 'w': np.insert(weights, breaks, 0.0).astype(np.float32)}
        for n in contents.numbers:
            speed = samples.qd[:, n]
            direction = np.where(np.abs(speed) <= REGIONS.rest_speed, 0.0, np.sign(speed))
            data |= {f'q{n}': self.column(samples.q[:, n]), f'v{n}': self.column(speed),
                     f'd{n}': self.column(direction), f'm{n}': self.column(samples.tau[:, n]),
                     f'p{n}': self.column(contents.predicted[:, n]),
                     f'r{n}': self.column(contents.residual[:, n])}
        self.source = ColumnDataSource(data)

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
        """Add columns in one update, because each update sends the whole table to the page."""
        self.source.data = {**self.source.data, **columns}

    @property
    def selected(self) -> list[int]:
        """Return the indices of the selected samples."""
        return [int(row) for row in self.rows[self.source.selected.indices] if row >= 0]

    def select(self, numbers: list[int]) -> None:
        """Select samples by index, as far as they are drawn."""
        self.source.selected.indices = np.flatnonzero(np.isin(self.rows, numbers)).tolist()


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
    gaps = np.flatnonzero((steps > REPORT.break_steps * median) & (steps > REPORT.break_seconds))
    gap = np.diff(np.searchsorted(gaps, rows)) > 0
    return np.flatnonzero(new_run | gap) + 1


def keep_extremes(runs: IntArray, values: FloatArray,
                  max_rows: int = REPORT.max_rows) -> tuple[IntArray, FloatArray]:
    """
    Return increasing sample indices, about `max_rows` of M, and the weight of each sample.

    Time is divided into intervals. The minimum and maximum of every column in each interval are
    kept, and so are the first and last samples of runs; equidistant samples fill the rest.
    Extremes have weight 1; the other weights sum to the number of remaining samples, so that
    weighted sums are unbiased.

    :param runs: the run of each sample (M,).
    :param values: the drawn values (M, K).
    """
    m, k = values.shape
    if m <= max_rows:
        return np.arange(m, dtype=np.int64), np.ones(m)
    intervals = max(1, max_rows // (4 * k))
    kept = [np.searchsorted(runs, np.unique(runs)),
            np.searchsorted(runs, np.unique(runs), side='right') - 1]
    edges = np.linspace(0, m, intervals + 1).astype(np.int64)
    for first, last in zip(edges[:-1], edges[1:]):
        part = values[first:last]
        kept += [first + part.argmin(axis=0), first + part.argmax(axis=0)]
    extremes = np.unique(np.concatenate(kept))
    filling = np.linspace(0, m - 1, max(max_rows - len(extremes), 2)).astype(np.int64)
    filling = np.setdiff1d(filling, extremes)
    rows = np.union1d(extremes, filling).astype(np.int64)
    weights = np.where(np.isin(rows, filling), (m - len(extremes)) / max(len(filling), 1), 1.0)
    return rows, weights
