"""Measured and predicted torque and residual of all joints over time."""

from __future__ import annotations

from typing import Any

from bokeh.layouts import column
from bokeh.models import CustomJS, Div, HoverTool, Label, Range1d, Span
from bokeh.models.tools import SelectTool
from bokeh.plotting import figure
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import canvas_text, plot, short, Style
from gravity_comp_ros.report.tiles import tiles

# Text on the selection: number of samples, time range, RMSE of each joint. A zoomed plot may have
# more selected samples than the shared table.
_SELECTION_TEXT = """
const table = lines.selected.indices.length > samples.selected.indices.length ? lines : samples
const rows = table.selected.indices
if (!rows.length) { selection.text = ''; return }
const t = table.get_column('t'), w = table.get_column('w')
let low = Infinity, high = -Infinity, count = 0
for (const row of rows) {
  low = Math.min(low, t[row])
  high = Math.max(high, t[row])
  count += w[row]
}
const place = (time) => {
  let run = 0
  while (run + 1 < starts.length && starts[run + 1] <= time + 1e-3) run++
  return [run, Math.max(time - starts[run], 0).toFixed(2)]
}
const [first, from] = place(low), [last, to] = place(high)
const where = first == last ? `${runs[first]}, ${from} to ${to} s`
  : `${runs[first]} at ${from} s to ${runs[last]} at ${to} s`
const errors = joints.map((name, k) => {
  const r = table.get_column('r' + numbers[k])
  let sum = 0
  for (const row of rows) sum += w[row] * r[row] * r[row]
  return `${name} ${Math.sqrt(sum / count).toFixed(3)}`
})
const about = rows.some(row => w[row] != 1) ? 'about ' : ''
selection.text = `<p><b>${about}${Math.round(count)} selected</b>: ${where}. ` +
  `RMSE, N·m: ${errors.join(', ')}</p>`
"""
_TALL, _LOW, _AXIS = 150, 112, 42
# Width of the y labels, equal in all plots so that their time axes are aligned.
_LEFT = 72
_MAX_LABELS = 12


def section(contents: Contents, table: Table, style: Style) -> Section:
    """Return two plots per joint with a common time axis."""
    time = table.range
    plots: list[figure] = []
    last = contents.numbers[-1]
    for n in contents.numbers:
        plots.append(_torque(contents, table, style, n, time, n == contents.numbers[0]))
        plots.append(_residual(table, style, n, time, n == last))
    runs = contents.samples.n_runs
    lead = markup.key([(style.measured, 'measured'), (style.predicted, 'predicted'),
                       (style.residual, 'residual: measured minus predicted'),
                       (style.marked, 'selected')])
    grid = tiles([[p] for p in plots])
    more = ', one after another' if runs > 1 else ''
    text = (f'{contents.samples.n_samples} samples of {runs} run{"s" if runs > 1 else ""}{more}. '
            'Drag to select samples; they are marked in every plot of this page. All joints share '
            'the zoom.')
    if table.is_thinned:
        text += (f' {len(table.drawn)} samples are drawn, including the minimum and maximum of '
                 'every time interval; zooming in draws more.')
    return Section('time', 'Over time', markup.paragraph(text, 'quiet') + lead,
                   column(_selection_text(contents, table), grid, sizing_mode='stretch_width'))


def _selection_text(contents: Contents, table: Table) -> Div:
    """Return a line on the selected samples."""
    line = Div(text='', disable_math=True, sizing_mode='stretch_width', name='selection',
               styles={'color': 'var(--text)', 'font-size': '14px'})
    args = {'samples': table.source, 'lines': table.lines, 'selection': line,
            'runs': [markup.text(short(name, 40)) for _, name in table.starts],
            'starts': [start for start, _ in table.starts], 'numbers': contents.numbers,
            'joints': [markup.text(name) for name in contents.joints]}
    for source in (table.source, table.lines):
        source.selected.js_on_change('indices', CustomJS(args=args, code=_SELECTION_TEXT))
    return line


def _torque(contents: Contents, table: Table, style: Style, n: int, time: Range1d,
            first: bool) -> figure:
    name = contents.model.joints[n]
    fig = plot(style, name, '', 'N·m', _TALL, x_range=time, min_border_left=_LEFT)
    _line(fig, table, f'm{n}', color=style.measured, line_width=1.2)
    _line(fig, table, f'p{n}', color=style.predicted, line_width=1.4, line_dash=[6, 3])
    _marks(fig, table, style, f'm{n}')
    fig.add_tools(_cursor(fig, [('measured', f'@m{n}{{0.000}} N·m'),
                                ('predicted', f'@p{n}{{0.000}} N·m'),
                                ('residual', f'@r{n}{{0.000}} N·m')]))
    fig.xaxis.visible = False
    fig.add_layout(table.cursor)
    _runs(fig, table, style, labelled=first)
    return fig


def _residual(table: Table, style: Style, n: int, time: Range1d, last: bool) -> figure:
    fig = plot(style, '', 'time in s' if last else '', 'residual, N·m', _LOW + _AXIS * last,
               x_range=time, min_border_left=_LEFT)
    _line(fig, table, f'r{n}', color=style.residual, line_width=1.0)
    _marks(fig, table, style, f'r{n}')
    fig.add_tools(_cursor(fig, [('residual', f'@r{n}{{0.000}} N·m')]))
    fig.add_layout(Span(location=0.0, dimension='width', line_color=style.faint, line_width=1))
    fig.xaxis.visible = last
    fig.yaxis.ticker.desired_num_ticks = 4
    fig.yaxis.axis_label_text_font_size = '11px'
    fig.add_layout(table.cursor)
    _runs(fig, table, style, labelled=False)
    return fig


def _cursor(fig: figure, values: list[tuple[str, str]]) -> HoverTool:
    """Return a tool that shows the values under the cursor."""
    return HoverTool(renderers=fig.renderers[:1], mode='vline',
                     tooltips=[('time', '@t{0.00} s'), *values])


def _line(fig: figure, table: Table, column: str, **looks: Any) -> None:
    """Draw a line whose style does not depend on the selection."""
    drawn = fig.line('t', column, source=table.lines, **looks)
    drawn.selection_glyph = drawn.nonselection_glyph = None


def _marks(fig: figure, table: Table, style: Style, column: str) -> None:
    """Draw points that are visible only if selected, because a box selects no lines."""
    marks = fig.scatter('t', column, source=table.lines, size=5, line_color=None,
                        fill_color=style.marked, fill_alpha=0.0, selection_fill_alpha=0.9,
                        nonselection_fill_alpha=0.0, selection_line_color=None,
                        nonselection_line_color=None)
    for tool in fig.select({'type': SelectTool}):
        tool.renderers = [marks]


def _runs(fig: figure, table: Table, style: Style, labelled: bool) -> None:
    for number, (start, name) in enumerate(table.starts):
        if number:
            fig.add_layout(Span(location=start, dimension='height', line_color=style.faint,
                                line_dash='dotted'))
        if labelled and 1 < len(table.starts) <= _MAX_LABELS:
            room = 110 // len(table.starts)
            label = name if len(name) <= room else f'{name[:max(room - 1, 3)]}…'
            fig.add_layout(Label(
                x=start, y=_TALL - 42, y_units='screen', text=canvas_text(printable(label)),
                text_font_size='11px', text_color=style.faint, x_offset=3,
                background_fill_color=style.background, background_fill_alpha=0.75))
