"""Heat maps of the residual and the sample count over pairs of joints."""

from __future__ import annotations

from bokeh.layouts import column
from bokeh.models import (
    ColorBar, ColumnDataSource, CustomJS, FixedTicker, HoverTool, LinearColorMapper,
    LogColorMapper, LogTicker, Range1d, Select)
from bokeh.plotting import figure
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import css, markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.pairs import pair_grid, PairGrid, places
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import canvas_text, plot, short, Style
from gravity_comp_ros.report.tiles import tiles
import numpy as np

_GAP = 0.06
_TOOLS = 'tap,box_select,reset,save'

# Selected cells mark their samples, and selected samples their cells. Callbacks run
# asynchronously, so each side stores the last selection it received and does not return it.
_CELLS_TO_SAMPLES = """
const chosen = cells.selected.indices, matches = []
if (String(chosen) == cells.received) return
if (chosen.length) {
  const [first, second, a, b] = ['i', 'j', 'a', 'b'].map(name => cells.get_column(name))
  const place = (joint) => samples.get_column('c' + joint)
  const rows = chosen.map(k => [place(first[k]), a[k], place(second[k]), b[k]])
  for (let row = 0; row < samples.get_column('t').length; row++)
    if (rows.some(([p, a, q, b]) => p[row] == a && q[row] == b)) matches.push(row)
}
samples.received = String(matches)
samples.selected.indices = matches
"""
_SAMPLES_TO_CELLS = """
const chosen = samples.selected.indices, matches = []
if (String(chosen) == samples.received) return
if (chosen.length) {
  const seen = new Set(), place = []
  const [first, second, a, b] = ['i', 'j', 'a', 'b'].map(name => cells.get_column(name))
  for (let joint = 0; joint < n; joint++) place.push(samples.get_column('c' + joint))
  for (const row of chosen)
    for (let i = 0; i < n; i++)
      for (let j = i; j < n; j++)
        seen.add(((i * n + j) * size + place[i][row]) * size + place[j][row])
  for (let k = 0; k < first.length; k++)
    if (seen.has(((first[k] * n + second[k]) * size + a[k]) * size + b[k])) matches.push(k)
}
cells.received = String(matches)
cells.selected.indices = matches
"""
_SHOW_JOINT = """
const rms = cells.get_column('e' + this.value), values = cells.get_column('shown')
let high = 0
for (let k = 0; k < rms.length; k++) {
  values[k] = rms[k]
  high = Math.max(high, rms[k])
}
colours.high = high
cells.change.emit()
"""


def section(contents: Contents, table: Table, style: Style) -> Section:
    """Return the residual of a selectable joint and the sample counts over all pairs."""
    numbers = contents.numbers
    grid = pair_grid(contents.samples.q[:, numbers], contents.residual[:, numbers])
    names = contents.joints
    cells = _cells(grid, contents)
    worst = names.index(contents.worst)
    high = float(grid.rms[:, worst].max()) or 1e-9
    error_colours = LinearColorMapper(palette=style.heat, low=0.0, high=high)
    count_colours = LogColorMapper(palette=style.heat, low=1,
                                   high=max(float(grid.count.max()), 2.0))
    error = _matrix(style, 'RMS of the residual, N·m', names, cells, 'shown', error_colours)
    counts = _matrix(style, 'samples', names, cells, 'count', count_colours)
    counts.select_one(ColorBar).ticker = LogTicker(desired_num_ticks=4)
    choice = Select(title='residual of joint', value=str(worst), width=260,
                    stylesheets=[css.CONTROL],
                    options=[(str(k), canvas_text(printable(x))) for k, x in enumerate(names)])
    choice.js_on_change('value', CustomJS(args={'cells': cells, 'colours': error_colours},
                                          code=_SHOW_JOINT))
    _link(table, contents, grid, cells)
    both = tiles([[error, counts]], 300)
    lead = markup.paragraph(
        'Each block is a pair of joints, each cell a part of their ranges; the diagonal shows '
        'single joints. Cells without colour were not visited: the model extrapolates there. '
        'Select a cell to mark its samples in the other plots.', 'quiet')
    return Section('pairs', 'Pairs of joints', lead,
                   column(choice, both, sizing_mode='stretch_width'), _coverage(grid, names))


def _cells(grid: PairGrid, contents: Contents) -> ColumnDataSource:
    """Return every visited cell as a rectangle, first joint to the right, second joint up."""
    n, size = len(contents.joints), grid.cells
    width = (1.0 - _GAP) / size
    own = grid.first == grid.second
    edges = grid.first + _GAP / 2 + grid.column * width
    # Cells on the diagonal are bars over the height of the block.
    top_down = np.where(own, 0, grid.row) * width
    low = (n - 1 - grid.second) + _GAP / 2 + top_down
    high = np.where(own, n - grid.second - _GAP / 2, low + width)
    data = {'left': edges, 'right': edges + width, 'bottom': low, 'top': high,
            'i': grid.first, 'j': grid.second, 'a': grid.column, 'b': grid.row,
            'count': grid.count, 'shown': grid.rms[:, contents.joints.index(contents.worst)],
            'x': 0.5 * (grid.edges[grid.first, grid.column]
                        + grid.edges[grid.first, grid.column + 1]),
            'y': 0.5 * (grid.edges[grid.second, grid.row] + grid.edges[grid.second, grid.row + 1])}
    floats = {k: v.astype(np.float32) for k, v in data.items() if v.dtype.kind == 'f'}
    whole = {k: v.astype(np.int32) for k, v in data.items() if v.dtype.kind != 'f'}
    errors = {f'e{k}': grid.rms[:, k].astype(np.float32) for k in range(n)}
    return ColumnDataSource({**floats, **whole, **errors})


def _matrix(style: Style, title: str, names: tuple[str, ...], cells: ColumnDataSource,
            field: str, colours: LinearColorMapper | LogColorMapper) -> figure:
    n = len(names)
    height = int(min(560, max(240, 150 + 62 * n)))
    fig = plot(style, title, '', '', height, _TOOLS, x_range=Range1d(0, n),
               y_range=Range1d(0, n))
    fig.grid.visible = False
    fig.axis.major_tick_line_color = None
    blocks = [(i, n - 1 - j) for i in range(n) for j in range(i, n)]
    half = _GAP / 2
    fig.quad(left=[x + half for x, _ in blocks], right=[x + 1 - half for x, _ in blocks],
             bottom=[y + half for _, y in blocks], top=[y + 1 - half for _, y in blocks],
             fill_color=style.never, line_color=style.grid, hatch_pattern='/',
             hatch_color=style.grid, hatch_scale=7, level='underlay')
    drawn = fig.quad('left', 'right', 'top', 'bottom', source=cells, line_color=None,
                     fill_color={'field': field, 'transform': colours},
                     nonselection_fill_alpha=0.35, selection_line_color=style.marked)
    fig.add_tools(HoverTool(renderers=[drawn], tooltips=[
        ('joint at the bottom', '@x{0.00} rad'), ('joint at the left', '@y{0.00} rad'),
        ('RMS', '@shown{0.000} N·m'), ('samples', '@count')]))
    ticks = [k + 0.5 for k in range(n)]
    labels = [canvas_text(short(printable(name))) for name in names]
    fig.xaxis.ticker = fig.yaxis.ticker = FixedTicker(ticks=ticks)
    fig.xaxis.major_label_overrides = dict(zip(ticks, labels))
    fig.yaxis.major_label_overrides = dict(zip(ticks, labels[::-1]))
    if max(len(name) for name in names) * n > 40:
        fig.xaxis.major_label_orientation = 0.8
    bar = ColorBar(color_mapper=colours, width=12, padding=6,
                   major_label_text_color=style.text, background_fill_color=style.background)
    fig.add_layout(bar, 'right')
    return fig


def _link(table: Table, contents: Contents, grid: PairGrid, cells: ColumnDataSource) -> None:
    numbers = contents.numbers
    place = places(contents.samples.q[:, numbers], grid.edges)
    table.add({f'c{k}': table.column(place[:, k]) for k in range(len(numbers))})
    args = {'cells': cells, 'samples': table.source, 'n': len(numbers), 'size': grid.cells}
    cells.selected.js_on_change('indices', CustomJS(args=args, code=_CELLS_TO_SAMPLES))
    table.source.selected.js_on_change('indices', CustomJS(args=args, code=_SAMPLES_TO_CELLS))


def _coverage(grid: PairGrid, names: tuple[str, ...]) -> str:
    if len(names) < 2:
        return ''
    pairs = sorted((float(grid.visited[i, j]), i, j) for i in range(len(names))
                   for j in range(i + 1, len(names)))
    share, i, j = pairs[0]
    return markup.paragraph(
        f'The pair with the lowest coverage is {names[i]} with {names[j]}: {100 * share:.0f} % '
        f'of the cells within their ranges were visited.')
