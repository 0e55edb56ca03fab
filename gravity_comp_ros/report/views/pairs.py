"""Residual, sample count and coverage over pairs of joints: grid and heat maps."""

from __future__ import annotations

from dataclasses import dataclass

from bokeh.models import (
    ColorBar, ColumnDataSource, CustomJS, FixedTicker, HoverTool, LinearColorMapper,
    LogColorMapper, LogTicker, Range1d)
from bokeh.plotting import figure
from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.options import REPORT
from gravity_comp_ros.report.section import JointSelector, Section, tiles
from gravity_comp_ros.report.style import GRID, HEAT, label, MARKED, plot
from gravity_comp_ros.report.table import Table
import numpy as np


@dataclass(frozen=True)
class PairGrid:
    """
    Grid of `cells` by `cells` over the ranges of each pair i <= j of N joints.

    `edges` (N, cells + 1) in rad divide each joint's range. `first` and `second` (K,) are the
    joints of each of K visited cells, `column` and `row` (K,) its indices along them. `count`
    (K,) is its number of samples, `rms` (K, N) the RMS residual of each joint in N·m. `visited`
    (N, N) is the share of cells with samples of each pair.
    """

    cells: int
    edges: FloatArray
    first: IntArray
    second: IntArray
    column: IntArray
    row: IntArray
    count: IntArray
    rms: FloatArray
    visited: FloatArray


def places(q: FloatArray, edges: FloatArray) -> IntArray:
    """Return the cell index (M, N) of each pose (M, N) along each joint."""
    cells = edges.shape[1] - 1
    indices = [np.searchsorted(edges[n], q[:, n], side='right') - 1 for n in range(q.shape[1])]
    return np.clip(np.column_stack(indices), 0, cells - 1).astype(np.int64)


def pair_grid(q: FloatArray, residual: FloatArray, cells: int = 12) -> PairGrid:
    """
    Return the grid over pairs of joints.

    :param q: poses (M, N) in rad.
    :param residual: (M, N) in N·m.
    """
    n = q.shape[1]
    low, high = q.min(axis=0), q.max(axis=0)
    width = np.maximum(high - low, REPORT.min_range)
    middle = 0.5 * (low + high)
    edges = np.linspace(middle - 0.5 * width, middle + 0.5 * width, cells + 1).T
    cells_of, squares = places(q, edges), residual ** 2
    parts: list[tuple[IntArray, ...]] = []
    rms, visited = [], np.zeros((n, n))
    for i in range(n):
        for j in range(i, n):
            cell = cells_of[:, i] * cells + cells_of[:, j]
            count = np.bincount(cell, minlength=cells * cells)
            filled = np.flatnonzero(count)
            sums = np.column_stack([np.bincount(cell, squares[:, k], cells * cells)[filled]
                                    for k in range(residual.shape[1])])
            rms.append(np.sqrt(sums / count[filled, None]))
            whole = cells if i == j else cells * cells
            visited[i, j] = visited[j, i] = len(filled) / whole
            parts.append((np.full(len(filled), i), np.full(len(filled), j), filled // cells,
                          filled % cells, count[filled]))
    first, second, column, row, count = (np.concatenate(x).astype(np.int64)
                                         for x in zip(*parts))
    return PairGrid(cells, edges, first, second, column, row, count, np.vstack(rms), visited)


_GAP = 0.06
_TOOLS = 'tap,box_select,reset,save'

# Selected cells mark their samples in all plots.
_MARK_SAMPLES = """
const chosen = cells.selected.indices, matches = []
const [first, second, a, b] = ['i', 'j', 'a', 'b'].map(name => cells.get_column(name))
const place = (joint) => samples.get_column('c' + joint)
const rows = chosen.map(k => [place(first[k]), a[k], place(second[k]), b[k]])
for (let row = 0; rows.length && row < samples.get_column('t').length; row++)
  if (rows.some(([p, a, q, b]) => p[row] == a && q[row] == b)) matches.push(row)
samples.selected.indices = matches
"""
_SHOW_JOINT = """
if (cb_obj.value == 'all') return
const rms = cells.get_column('e' + cb_obj.value)
colours.high = Math.max(...rms, 1e-9)
title.text = titles[cb_obj.value]
cells.data = {...cells.data, shown: rms}
"""


def section(contents: Contents, table: Table, selector: JointSelector) -> Section:
    """Return the residual of the selected joint and the sample counts over all pairs."""
    numbers, names = contents.numbers, contents.joints
    grid = pair_grid(contents.samples.q[:, numbers], contents.residual[:, numbers])
    chosen = selector.select.value
    joint = int(chosen) if chosen.isdecimal() else names.index(contents.worst)
    cells = _cells(grid, joint)
    error_colours = LinearColorMapper(palette=HEAT, low=0.0,
                                      high=float(grid.rms[:, joint].max()) or 1e-9)
    count_colours = LogColorMapper(palette=HEAT, low=1, high=max(float(grid.count.max()), 2.0))
    titles = [label(f'residual of {name}, RMS in N·m', 60) for name in names]
    error = _matrix(titles[joint], names, cells, 'shown', error_colours)
    counts = _matrix('samples', names, cells, 'count', count_colours)
    counts.select_one(ColorBar).ticker = LogTicker(desired_num_ticks=4)
    selector.on_change(_SHOW_JOINT, cells=cells, colours=error_colours, title=error.title,
                       titles=titles)
    place = places(contents.samples.q[:, numbers], grid.edges)
    table.add({f'c{k}': table.column(place[:, k]) for k in range(len(numbers))})
    cells.selected.js_on_change('indices', CustomJS(code=_MARK_SAMPLES, args={
        'cells': cells, 'samples': table.source}))
    lead = markup.paragraph(
        'Each block is a pair of joints, each cell a part of their ranges; the diagonal shows '
        'single joints. Cells without colour were not visited: the model extrapolates there. '
        'Select a cell to mark its samples in the other plots.', 'quiet')
    return Section('pairs', 'Pairs of joints', lead, tiles([error, counts], 300),
                   _coverage(grid, names))


def _cells(grid: PairGrid, joint: int) -> ColumnDataSource:
    """Return every visited cell as a rectangle, first joint to the right, second joint up."""
    n, size = len(grid.edges), grid.cells
    width = (1.0 - _GAP) / size
    own = grid.first == grid.second
    edges = grid.first + _GAP / 2 + grid.column * width
    # Cells on the diagonal are bars over the height of the block.
    top_down = np.where(own, 0, grid.row) * width
    low = (n - 1 - grid.second) + _GAP / 2 + top_down
    high = np.where(own, n - grid.second - _GAP / 2, low + width)
    data = {'left': edges, 'right': edges + width, 'bottom': low, 'top': high,
            'i': grid.first, 'j': grid.second, 'a': grid.column, 'b': grid.row,
            'count': grid.count, 'shown': grid.rms[:, joint],
            'x': 0.5 * (grid.edges[grid.first, grid.column]
                        + grid.edges[grid.first, grid.column + 1]),
            'y': 0.5 * (grid.edges[grid.second, grid.row] + grid.edges[grid.second, grid.row + 1])}
    floats = {k: v.astype(np.float32) for k, v in data.items() if v.dtype.kind == 'f'}
    whole = {k: v.astype(np.int32) for k, v in data.items() if v.dtype.kind != 'f'}
    errors = {f'e{k}': grid.rms[:, k].astype(np.float32) for k in range(n)}
    return ColumnDataSource({**floats, **whole, **errors})


def _matrix(title: str, names: tuple[str, ...], cells: ColumnDataSource,
            field: str, colours: LinearColorMapper | LogColorMapper) -> figure:
    n = len(names)
    height = int(min(560, max(240, 150 + 62 * n)))
    fig = plot(title, '', '', height, _TOOLS, x_range=Range1d(0, n),
               y_range=Range1d(0, n))
    fig.grid.visible = False
    fig.axis.major_tick_line_color = None
    blocks = [(i, n - 1 - j) for i in range(n) for j in range(i, n)]
    half = _GAP / 2
    fig.quad(left=[x + half for x, _ in blocks], right=[x + 1 - half for x, _ in blocks],
             bottom=[y + half for _, y in blocks], top=[y + 1 - half for _, y in blocks],
             fill_color='#f3f4f6', line_color=GRID, hatch_pattern='/',
             hatch_color=GRID, hatch_scale=7, level='underlay')
    drawn = fig.quad('left', 'right', 'top', 'bottom', source=cells, line_color=None,
                     fill_color={'field': field, 'transform': colours},
                     nonselection_fill_alpha=0.35, selection_line_color=MARKED)
    fig.add_tools(HoverTool(renderers=[drawn], tooltips=[
        ('joint at the bottom', '@x{0.00} rad'), ('joint at the left', '@y{0.00} rad'),
        ('RMS', '@shown{0.000} N·m'), ('samples', '@count')]))
    ticks = [k + 0.5 for k in range(n)]
    labels = [label(name) for name in names]
    fig.xaxis.ticker = fig.yaxis.ticker = FixedTicker(ticks=ticks)
    fig.xaxis.major_label_overrides = dict(zip(ticks, labels))
    fig.yaxis.major_label_overrides = dict(zip(ticks, labels[::-1]))
    if max(len(name) for name in names) * n > 40:
        fig.xaxis.major_label_orientation = 0.8
    fig.add_layout(ColorBar(color_mapper=colours, width=12, padding=6), 'right')
    return fig


def _coverage(grid: PairGrid, names: tuple[str, ...]) -> str:
    if len(names) < 2:
        return ''
    pairs = sorted((float(grid.visited[i, j]), i, j) for i in range(len(names))
                   for j in range(i + 1, len(names)))
    share, i, j = pairs[0]
    return markup.paragraph(
        f'The pair with the lowest coverage is {names[i]} with {names[j]}: {100 * share:.0f} % '
        f'of the cells within their ranges were visited.')
