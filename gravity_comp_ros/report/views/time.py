"""Measured and predicted torque over time, the residual below, all joints."""

from __future__ import annotations

from bokeh.layouts import column
from bokeh.models import CustomJS, Div, HoverTool, Label, Range1d, Span
from bokeh.plotting import figure
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import canvas_text, padded, plot, short, Style
from gravity_comp_ros.report.tiles import tiles

# What is selected, in numbers: samples, time in its recording, RMSE of each joint.
_NUMBERS = """
const rows = samples.selected.indices
if (!rows.length) { told.text = ''; return }
const t = samples.get_column('t')
let low = Infinity, high = -Infinity
for (const row of rows) { low = Math.min(low, t[row]); high = Math.max(high, t[row]) }
const place = (time) => {
  let run = 0
  while (run + 1 < starts.length && starts[run + 1] <= time + 1e-9) run++
  return [run, (time - starts[run]).toFixed(2)]
}
const [first, from] = place(low), [last, to] = place(high)
const where = first == last ? `${runs[first]}, ${from} to ${to} s`
  : `${runs[first]} at ${from} s to ${runs[last]} at ${to} s`
const errors = joints.map((name, k) => {
  const r = samples.get_column('r' + numbers[k])
  let sum = 0
  for (const row of rows) sum += r[row] * r[row]
  return `${name} ${Math.sqrt(sum / rows.length).toFixed(3)}`
})
told.text = `<p><b>${rows.length} selected</b>: ${where}. RMSE, N·m: ${errors.join(', ')}</p>`
"""
_TALL, _LOW, _AXIS = 150, 112, 42
_MOST_LABELS = 12


def section(contents: Contents, table: Table, style: Style) -> Section:
    """Return two plots a joint, all with the same time axis."""
    time = padded(0.0, float(table.time.max()), 0.01)
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
    thinned = len(table.drawn) < contents.samples.n_samples
    told = (f'{contents.samples.n_samples} samples of {runs} run{"s" if runs > 1 else ""}{more}. '
            'Drag to select: what is selected here is marked in every plot of this page. Zoom is '
            'common to all joints.')
    if thinned:
        told += (f' {len(table.drawn)} samples are drawn, the largest and smallest of every '
                 'stretch of time among them.')
    numbers = _numbers(contents, table)
    return Section('time', 'Over time', markup.paragraph(told, 'quiet') + lead,
                   column(numbers, grid, sizing_mode='stretch_width'))


def _numbers(contents: Contents, table: Table) -> Div:
    """Return a line that says in numbers what is selected."""
    told = Div(text='', disable_math=True, sizing_mode='stretch_width', name='selection',
               styles={'color': 'var(--text)', 'font-size': '14px'})
    runs = [markup.text(short(name, 40)) for _, name in table.starts]
    told_by = {'samples': table.source, 'told': told, 'runs': runs,
               'starts': [start for start, _ in table.starts], 'numbers': contents.numbers,
               'joints': [markup.text(name) for name in contents.joints]}
    table.source.selected.js_on_change('indices', CustomJS(args=told_by, code=_NUMBERS))
    return told


def _torque(contents: Contents, table: Table, style: Style, n: int, time: Range1d,
            first: bool) -> figure:
    name = contents.model.joints[n]
    made = plot(style, name, '', 'N·m', _TALL, x_range=time)
    made.line('t', f'm{n}', source=table.lines, color=style.measured, line_width=1.2)
    made.line('t', f'p{n}', source=table.lines, color=style.predicted, line_width=1.4,
              line_dash=[6, 3], nonselection_line_alpha=1.0)
    _marks(made, table, style, f'm{n}')
    made.add_tools(_cursor(made, [('measured', f'@m{n}{{0.000}} N·m'),
                                  ('predicted', f'@p{n}{{0.000}} N·m'),
                                  ('residual', f'@r{n}{{0.000}} N·m')]))
    made.xaxis.visible = False
    _runs(made, table, style, labelled=first)
    return made


def _residual(table: Table, style: Style, n: int, time: Range1d, last: bool) -> figure:
    made = plot(style, '', 'time in s' if last else '', 'residual, N·m', _LOW + _AXIS * last,
                x_range=time)
    made.title.visible = False
    made.line('t', f'r{n}', source=table.lines, color=style.residual, line_width=1.0)
    _marks(made, table, style, f'r{n}')
    made.add_tools(_cursor(made, [('residual', f'@r{n}{{0.000}} N·m')]))
    made.add_layout(Span(location=0.0, dimension='width', line_color=style.faint, line_width=1))
    made.xaxis.visible = last
    made.yaxis.ticker.desired_num_ticks = 4
    made.yaxis.axis_label_text_font_size = '11px'
    _runs(made, table, style, labelled=False)
    return made


def _cursor(made: figure, values: list[tuple[str, str]]) -> HoverTool:
    """Return a tool that shows the values under the cursor."""
    return HoverTool(renderers=made.renderers[:1], mode='vline',
                     tooltips=[('time', '@t{0.00} s'), *values])


def _marks(made: figure, table: Table, style: Style, column: str) -> None:
    """Draw points that show only where they are selected."""
    made.scatter('t', column, source=table.source, size=5, line_color=None,
                 fill_color=style.marked, fill_alpha=0.0, selection_fill_alpha=0.9,
                 nonselection_fill_alpha=0.0, selection_line_color=None,
                 nonselection_line_color=None)


def _runs(made: figure, table: Table, style: Style, labelled: bool) -> None:
    for number, (start, name) in enumerate(table.starts):
        if number:
            made.add_layout(Span(location=start, dimension='height', line_color=style.faint,
                                 line_dash='dotted'))
        if labelled and len(table.starts) > 1 and len(table.starts) <= _MOST_LABELS:
            room = 110 // len(table.starts)
            shown = name if len(name) <= room else f'{name[:max(room - 1, 3)]}…'
            made.add_layout(Label(
                x=start, y=_TALL - 42, y_units='screen', text=canvas_text(printable(shown)),
                text_font_size='11px', text_color=style.faint, x_offset=3,
                background_fill_color=style.background, background_fill_alpha=0.75))
