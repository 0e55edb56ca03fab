"""Data table shared by all plots, so that a selection in one is marked in all."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from typing import Any

from bokeh.models import ColumnDataSource, CustomJS, Span
from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.report.contents import Contents, plot_time, REST_SPEED
from gravity_comp_ros.report.decimate import keep_extremes, MAX_ROWS
from gravity_comp_ros.report.style import padded, PURPLE
import numpy as np
from numpy.typing import NDArray

# Minimum gap that breaks a line, in median steps and in s.
_BREAK_STEPS, _BREAK_SECONDS = 20.0, 2.0
# Number of rows of the lines embedded in a report, for zooming.
_FINE_ROWS = 30_000
Columns = dict[str, NDArray[Any]]

# Synchronises the selections of both tables by sample number. Callbacks run asynchronously, so
# each table stores the last selection it received and does not return it.
_SYNCHRONISE_SELECTION = """
if (cb_obj !== to && String(from.selected.indices) == from.matched) return
const number = from.get_column('k'), other = to.get_column('k')
const selected = new Set(from.selected.indices.map(row => number[row])), matches = []
if (selected.size)
  for (let row = 0; row < other.length; row++) if (selected.has(other[row])) matches.push(row)
to.matched = String(matches)
to.selected.indices = matches
"""
# Draws a short window from the embedded fine rows; they are decoded at first use.
_ZOOM = """
if (!lines.fine) {
  lines.whole = lines.data
  lines.fine = {}
  for (const [name, text] of Object.entries(fine)) {
    const bytes = Uint8Array.from(atob(text), letter => letter.charCodeAt(0)).buffer
    lines.fine[name] = name == 'k' ? new Int32Array(bytes) : new Float32Array(bytes)
  }
}
clearTimeout(lines.waits)
lines.waits = setTimeout(() => {
  const t = lines.fine.t
  let first = t.length, last = 0
  for (let row = 0; row < t.length; row++)
    if (t[row] >= range.start && t[row] <= range.end) {
      first = Math.min(first, row)
      last = row
    }
  first = Math.max(first - 1, 0)
  last = Math.min(last + 2, t.length)
  let data = lines.whole
  if (last > first && last - first < max_rows) {
    data = {}
    for (const [name, whole] of Object.entries(lines.fine)) data[name] = whole.slice(first, last)
    for (const n of numbers) data['r' + n] = data['m' + n].map((m, row) => m - data['p' + n][row])
  }
  if (data !== lines.data) lines.data = data
}, 60)
"""


class Table:
    """
    Decimated samples for all plots, with breaks between runs and in long gaps.

    Columns, for the model's joint n: `q{n}` rad, `v{n}` rad/s, `m{n}`, `p{n}` and `r{n}` N·m
    (measured, predicted, residual), `d{n}` the direction of motion as -1, 0, 1; `t` in s with
    runs one after another; the sample index `k`, and its weight `w` in samples. `rows` (R,) are
    sample indices, -1 for a break. `lines` has the columns over time, refined in the visible
    window `range`. `cursor` marks the time of the drawn pose.
    """

    def __init__(self, contents: Contents) -> None:
        samples = contents.samples
        self.contents = contents
        self.time, self.starts = plot_time(samples)
        self.rows, self._weights = self._drawn(np.arange(samples.n_samples), None)
        self.range = padded(0.0, float(self.time.max()), 0.01)
        self._window = (self.range.start, self.range.end)
        data = self._over_time(self.rows, self._weights)
        more: Columns = {}
        for n in contents.numbers:
            speed = samples.qd[:, n]
            direction = np.where(np.abs(speed) <= REST_SPEED, 0.0, np.sign(speed))
            more |= {f'q{n}': self.column(samples.q[:, n]), f'v{n}': self.column(speed),
                     f'd{n}': self.column(direction)}
        self.source = ColumnDataSource({**data, **more})
        # The time of the drawn pose, in all plots over time.
        self.cursor = Span(dimension='height', visible=False, line_width=1.5, line_color=PURPLE)
        # A zoomed window has more rows than the shared table.
        self.lines = ColumnDataSource(data)
        to_lines, to_source = (
            CustomJS(args={'from': a, 'to': b}, code=_SYNCHRONISE_SELECTION)
            for a, b in ((self.source, self.lines), (self.lines, self.source)))
        self.source.selected.js_on_change('indices', to_lines)
        self.lines.selected.js_on_change('indices', to_source)
        self.lines.js_on_change('data', to_lines)

    def column(self, values: FloatArray | IntArray) -> NDArray[np.float32]:
        """Return values (M,) at the drawn rows; NaN at breaks."""
        return _at(self.rows, values)

    def spread(self, values: FloatArray) -> NDArray[np.float32]:
        """Return a column of values of the drawn samples; NaN at breaks."""
        column = np.full(len(self.rows), np.nan, dtype=np.float32)
        column[self.rows >= 0] = values
        return column

    def add(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """Add columns in one update, because each update sends the whole table to the page."""
        self.source.data = {**self.source.data, **columns}

    @property
    def drawn(self) -> IntArray:
        """Return the drawn sample indices without breaks."""
        return self.rows[self.rows >= 0]

    @property
    def selected(self) -> list[int]:
        """Return the indices of the selected samples."""
        return [int(row) for row in self.rows[self.source.selected.indices] if row >= 0]

    def select(self, numbers: list[int]) -> None:
        """Select samples by index, as far as they are drawn."""
        self.source.selected.indices = np.flatnonzero(np.isin(self.rows, numbers)).tolist()

    @property
    def is_thinned(self) -> bool:
        """Return whether fewer samples are drawn than recorded."""
        return len(self.drawn) < self.contents.samples.n_samples

    def follow_window(self) -> None:
        """Draw the visible window in full resolution, from all samples."""
        window = (self.range.start, self.range.end)
        if window == self._window or not self.is_thinned:
            return
        self._window = window
        inside = np.flatnonzero((self.time >= window[0]) & (self.time <= window[1]))
        if not len(inside):
            return
        # Include one sample beyond each edge, and all rows of the shared table.
        first, last = max(inside[0] - 1, 0), min(inside[-1] + 2, len(self.time))
        rows, weights = self._drawn(np.arange(first, last), self.drawn)
        self.lines.data = dict(self._over_time(rows, weights))

    def embed_fine_lines(self) -> None:
        """Embed more rows for zooming in a page without a server."""
        if not self.is_thinned:
            return
        rows, weights = self._drawn(np.arange(len(self.time)), self.drawn, _FINE_ROWS)
        columns = self._over_time(rows, weights)
        fine = {name: b64encode(column.astype(column.dtype.newbyteorder('<')).tobytes()).decode()
                for name, column in columns.items() if name[0] != 'r'}
        follow = CustomJS(args={'lines': self.lines, 'fine': fine, 'range': self.range,
                                'max_rows': len(self.rows), 'numbers': self.contents.numbers},
                          code=_ZOOM)
        for edge in ('start', 'end'):
            self.range.js_on_change(edge, follow)

    def _drawn(self, among: IntArray, always: IntArray | None,
               max_rows: int = MAX_ROWS) -> tuple[IntArray, FloatArray]:
        """Return the rows to draw of some samples, -1 at breaks, and their weights."""
        samples = self.contents.samples
        kept, weights = keep_extremes(samples.runs[among], self.contents.extent[among], max_rows)
        rows = among[kept]
        if always is not None:
            more = np.setdiff1d(always[(always >= among[0]) & (always <= among[-1])], rows)
            order = np.argsort(np.concatenate([rows, more]))
            rows = np.concatenate([rows, more])[order]
            weights = np.concatenate([weights, np.zeros(len(more))])[order]
        places = _breaks(self.contents, rows)
        return np.insert(rows, places, -1), np.insert(weights, places, 0.0)

    def _over_time(self, rows: IntArray, weights: FloatArray) -> Columns:
        contents = self.contents
        columns: Columns = {'t': _at(rows, self.time), 'k': rows.astype(np.int32),
                            'w': weights.astype(np.float32)}
        for n in contents.numbers:
            columns |= {f'm{n}': _at(rows, contents.samples.tau[:, n]),
                        f'p{n}': _at(rows, contents.predicted[:, n]),
                        f'r{n}': _at(rows, contents.residual[:, n])}
        return columns


def _at(rows: IntArray, values: FloatArray | IntArray) -> NDArray[np.float32]:
    drawn = np.asarray(values, dtype=np.float32)[np.maximum(rows, 0)]
    drawn[rows < 0] = np.nan
    return drawn


def _breaks(contents: Contents, rows: IntArray) -> IntArray:
    samples = contents.samples
    new_run = np.diff(samples.runs[rows]) > 0
    steps = np.diff(samples.t)
    median = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    # Gaps of the recording, not gaps from decimation.
    gaps = np.flatnonzero((steps > _BREAK_STEPS * median) & (steps > _BREAK_SECONDS))
    gap = np.diff(np.searchsorted(gaps, rows)) > 0
    return np.flatnonzero(new_run | gap) + 1
