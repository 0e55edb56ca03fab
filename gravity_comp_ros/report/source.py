"""The one table that all plots draw from: what is selected in one is marked in all."""

from __future__ import annotations

from collections.abc import Mapping

from bokeh.models import ColumnDataSource
from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.report.contents import Contents, plot_time, STILL
import numpy as np
from numpy.typing import NDArray

# A break in a line: longer than this many usual steps, and than this many seconds.
_BREAK_STEPS, _BREAK_SECONDS = 20.0, 2.0


class Table:
    """
    The drawn rows of all samples, with breaks between runs and over long gaps.

    Columns, for the model's joint n: `q{n}` rad, `v{n}` rad/s, `m{n}`, `p{n}` and `r{n}` N·m
    (measured, predicted, residual), `d{n}` the direction of motion as -1, 0, 1; and `t` in s
    with runs one after another. `rows` (R,) are sample numbers, -1 for a break.
    """

    def __init__(self, contents: Contents) -> None:
        samples = contents.samples
        time, self.starts = plot_time(samples)
        self.rows = _with_breaks(contents)
        self.time = time
        data = {'t': self.column(time)}
        for n in contents.numbers:
            speed = samples.qd[:, n]
            direction = np.where(np.abs(speed) <= STILL, 0.0, np.sign(speed))
            for letter, values in (('q', samples.q[:, n]), ('v', speed),
                                   ('m', samples.tau[:, n]), ('p', contents.predicted[:, n]),
                                   ('r', contents.residual[:, n]), ('d', direction)):
                data[f'{letter}{n}'] = self.column(values)
        self.source = ColumnDataSource(data)
        # A box that touches a line would select all of it, so lines have a table of their own.
        self.lines = ColumnDataSource({k: v for k, v in data.items() if k[0] in 'tmpr'})

    def column(self, values: FloatArray | IntArray) -> NDArray[np.float32]:
        """Return values (M,) at the drawn rows; not a number at breaks."""
        drawn = np.asarray(values, dtype=np.float32)[np.maximum(self.rows, 0)]
        drawn[self.rows < 0] = np.nan
        return drawn

    def spread(self, values: FloatArray) -> NDArray[np.float32]:
        """Return a column of values at the drawn rows that are no breaks."""
        column = np.full(len(self.rows), np.nan, dtype=np.float32)
        column[self.rows >= 0] = values
        return column

    def add(self, columns: Mapping[str, NDArray[np.float32]]) -> None:
        """Add columns, all at once: a page that is open gets the whole table anew."""
        self.source.data = {**self.source.data, **columns}

    @property
    def drawn(self) -> IntArray:
        """Return the drawn sample numbers without breaks."""
        return self.rows[self.rows >= 0]


def _with_breaks(contents: Contents) -> IntArray:
    samples, rows = contents.samples, contents.rows
    new_run = np.diff(samples.runs[rows]) > 0
    steps = np.diff(samples.t)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    # A gap of the recording, not one that comes from drawing fewer rows.
    gaps = np.flatnonzero((steps > _BREAK_STEPS * usual) & (steps > _BREAK_SECONDS))
    gap = np.diff(np.searchsorted(gaps, rows)) > 0
    places = np.flatnonzero(new_run | gap) + 1
    return np.insert(rows, places, -1)
