"""Torque and residual over time; residual against speed, position and load; its spectrum."""

from __future__ import annotations

from typing import Any

from bokeh.layouts import column
from bokeh.models import (
    CustomJS, DataRange1d, Div, HoverTool, Label, LinearColorMapper, Select, Span)
from bokeh.models.tools import SelectTool
from bokeh.plotting import figure
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.printable import counted
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents, REPORT, Table
from gravity_comp_ros.report.section import by_joint, Section
from gravity_comp_ros.report.style import (
    DOWN, FAINT, label, MARKED, MEASURED, plot, PREDICTED, RESIDUAL, short, STILL, UP)
import numpy as np

# Text on the selection: number of drawn samples, time range as `gravity_comp cut` takes it.
_SELECTION_TEXT = """
const t = samples.get_column('t'), times = samples.selected.indices.map(row => t[row])
const place = (time) => {
  const run = Math.max(starts.findLastIndex(start => start <= time + 1e-3), 0)
  return `${runs[run]} at ${Math.max(time - starts[run], 0).toFixed(2)} s`
}
const [low, high] = times.reduce(([a, b], x) => [Math.min(a, x), Math.max(b, x)], [1e99, -1e99])
selection.text = !times.length ? ''
  : `<p><b>${times.length} drawn samples selected</b>: ${place(low)} to ${place(high)}</p>`
"""
_TALL, _LOW, _SQUARE = 190, 150, 187
# Width of the y labels, equal in all plots so that their time axes are aligned.
_LEFT = 72
_MAX_LABELS = 12


def time_section(contents: Contents, table: Table, selector: Select) -> Section:
    """Return two plots per joint with a common time axis."""
    def plots(k: int) -> list[figure]:
        n = contents.numbers[k]
        return [_torque(contents, table, n), over_time(contents, table, n)]

    runs = contents.samples.n_runs
    more = ', one after another' if runs > 1 else ''
    text = (f'{contents.samples.n_samples} samples of {counted(runs, "run")}{more}. '
            'Drag to select samples; they are marked in every plot of this page.')
    if len(table.drawn) < contents.samples.n_samples:
        text += (f' {len(table.drawn)} samples are drawn, including the minimum and maximum of '
                 'every time interval.')
    lead = markup.paragraph(text, 'quiet') + markup.key(
        [(MEASURED, 'measured'), (PREDICTED, 'predicted'),
         (RESIDUAL, 'residual: measured minus predicted'), (MARKED, 'selected')])
    return Section('time', 'Over time', lead, column(
        _selection_text(table), by_joint(selector, plots, 900),
        sizing_mode='stretch_width'))


def _selection_text(table: Table) -> Div:
    """Return a line on the selected samples."""
    line = Div(text='', disable_math=True, sizing_mode='stretch_width', name='selection',
               styles={'color': 'var(--text)', 'font-size': '14px'})
    table.source.selected.js_on_change('indices', CustomJS(code=_SELECTION_TEXT, args={
        'samples': table.source, 'selection': line,
        'runs': [markup.text(short(name, 40)) for _, name in table.starts],
        'starts': [start for start, _ in table.starts]}))
    return line


def _torque(contents: Contents, table: Table, n: int) -> figure:
    fig = plot(contents.model.joints[n], '', 'N·m', _TALL, x_range=table.range,
               min_border_left=_LEFT)
    _line(fig, table, f'm{n}', color=MEASURED, line_width=1.2)
    _line(fig, table, f'p{n}', color=PREDICTED, line_width=1.4, line_dash=[6, 3])
    _complete(fig, table, f'm{n}', [('measured', f'@m{n}{{0.000}} N·m'),
                                    ('predicted', f'@p{n}{{0.000}} N·m'),
                                    ('residual', f'@r{n}{{0.000}} N·m')])
    for start, name in table.starts if 1 < len(table.starts) <= _MAX_LABELS else ():
        fig.add_layout(Label(
            x=start, y=_TALL - 90, y_units='screen', x_offset=3, text_font_size='11px',
            text_color=FAINT, text=label(name, max(110 // len(table.starts), 4)),
            background_fill_color='white', background_fill_alpha=0.75))
    return fig


def over_time(contents: Contents, table: Table, n: int) -> figure:
    """Return the residual of joint n over time."""
    name = contents.model.joints[n]
    fig = plot(f'{short(name, 20)}, RMSE {contents.error(name)} N·m', 'time, s',
               'residual, N·m', _LOW, x_range=table.range, min_border_left=_LEFT)
    _line(fig, table, f'r{n}', color=RESIDUAL, line_width=1.0)
    _complete(fig, table, f'r{n}', [('residual', f'@r{n}{{0.000}} N·m')])
    fig.add_layout(Span(location=0.0, dimension='width', line_color=FAINT, line_width=1))
    fig.yaxis.ticker.desired_num_ticks = 4
    return fig


def _line(fig: figure, table: Table, column: str, **looks: Any) -> None:
    """Draw a line whose style does not depend on the selection."""
    drawn = fig.line('t', column, source=table.source, **looks)
    drawn.selection_glyph = drawn.nonselection_glyph = None


def _complete(fig: figure, table: Table, column: str, values: list[tuple[str, str]]) -> None:
    """Add what plots over time have in common: values under the cursor, selection, runs."""
    fig.add_tools(HoverTool(renderers=fig.renderers[:1], mode='vline',
                            tooltips=[('time', '@t{0.00} s'), *values]))
    # Points that are visible only if selected, because a box selects no lines.
    marks = fig.scatter('t', column, source=table.source, size=5, line_color=None,
                        fill_color=MARKED, fill_alpha=0.0, selection_fill_alpha=0.9,
                        nonselection_fill_alpha=0.0, selection_line_color=None,
                        nonselection_line_color=None)
    for tool in fig.select({'type': SelectTool}):
        tool.renderers = [marks]
    fig.add_layout(table.cursor)
    for start, _ in table.starts[1:]:
        fig.add_layout(Span(location=start, dimension='height', line_color=FAINT,
                            line_dash='dotted'))


# Title and unit of the axis, by the letter of the column.
_AGAINST = {'v': ('own speed', 'rad/s'), 'q': ('own position', 'rad'),
            'p': ('own load (predicted)', 'N·m'), 't': ('time', 's')}


def section(contents: Contents, table: Table, selector: Select) -> Section:
    """Return the residual over four quantities, and its spectrum over the angle, per joint."""
    def plots(k: int) -> list[figure]:
        common, n = DataRange1d(range_padding=0.06), contents.numbers[k]
        return [*(against(contents, table, n, letter, common, letter == 'v')
                  for letter in _AGAINST), _spectrum(contents, n)]

    lead = markup.paragraph(
        'A correct model gives horizontal bands. A step at speed 0 indicates friction, a slope '
        'over speed viscous friction, over load a wrong gain or load-dependent friction, over '
        'position a spring or a missing term, over time a drift. A line at an integer number of '
        'cycles per revolution indicates a gear or a bearing.', 'quiet')
    lead += markup.key([(UP, 'moving up'), (DOWN, 'moving down'), (STILL, 'at rest'),
                        (MARKED, 'selected')])
    return Section('residuals', 'Residual against speed, position, load and time', lead,
                   by_joint(selector, plots, 290))


def against(contents: Contents, table: Table, n: int, letter: str,
            common: DataRange1d | None = None, is_first: bool = True) -> figure:
    """
    Return the residual of joint n against the column of a letter.

    :param common: y range shared by a row of plots.
    :param is_first: whether to name the joint, its error and the y axis.
    """
    title, unit = _AGAINST[letter]
    x, name = 't' if letter == 't' else f'{letter}{n}', contents.model.joints[n]
    heading = f'{short(name, 20)}, RMSE {contents.error(name)} N·m' if is_first else ''
    ranges = {} if common is None else {'y_range': common}
    fig = plot(heading, f'{title}, {unit}', 'residual, N·m' if is_first else '', _SQUARE,
               'pan,box_zoom,wheel_zoom,box_select,lasso_select,tap,hover,reset,save', **ranges)
    colours = LinearColorMapper(palette=[DOWN, STILL, UP], low=-1.5, high=1.5)
    fig.scatter(x, f'r{n}', source=table.source, size=3, marker='square', line_color=None,
                fill_color={'field': f'd{n}', 'transform': colours}, fill_alpha=0.55,
                selection_fill_color=MARKED, selection_fill_alpha=0.95,
                nonselection_fill_alpha=0.12, nonselection_line_color=None,
                selection_line_color=None)
    fig.add_layout(Span(location=0.0, dimension='width', line_color=FAINT, line_width=1))
    fig.hover.tooltips = [(title, f'@{x}{{0.0000}} {unit}'), ('residual', f'@r{n}{{0.000}} N·m'),
                          ('time', '@t{0.00} s')]
    fig.axis.ticker.desired_num_ticks = 4
    return fig


def over_angle(q: FloatArray, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return orders (cycles per revolution) and amplitudes in N·m of one joint's residual.

    They are those of the Lomb-Scargle periodogram, so poses may be uneven. The lowest order is one
    cycle over the visited range. Both arrays are empty if the joint travels less than 0.05 rad.

    :param q: the joint's angle (M,) in rad.
    :param residual: (M,) in N·m.
    """
    travel = float(np.ptp(q)) if len(q) else 0.0
    if travel < REPORT.min_travel:
        return np.zeros(0), np.zeros(0)
    rows = np.arange(0, len(q), max(1, len(q) // REPORT.max_rows))
    q, residual = q[rows], residual[rows] - residual[rows].mean()
    lowest = 2.0 * np.pi / travel
    count = int(REPORT.max_order / (REPORT.order_step * lowest)) + 1
    orders = REPORT.order_step * lowest * np.arange(2.0, count)
    from scipy import signal  # imported here because it takes 0.5 s
    power = signal.lombscargle(q, residual, orders)
    return orders, np.asarray(2.0 * np.sqrt(np.maximum(power, 0.0) / len(q)))


def _spectrum(contents: Contents, n: int) -> figure:
    """Return the amplitude of the residual of joint n over cycles per revolution."""
    fig = plot('', 'cycles per revolution', 'amplitude, N·m', _SQUARE,
               'xpan,xbox_zoom,hover,reset,save')
    orders, amplitude = over_angle(contents.samples.q[:, n], contents.residual[:, n])
    fig.line(orders, amplitude, color=RESIDUAL, line_width=1.2)
    fig.varea(orders, 0.0 * orders, amplitude, fill_color=RESIDUAL, fill_alpha=0.25)
    fig.hover.tooltips = [('cycles per revolution', '@x{0.0}'), ('amplitude', '@y{0.000} N·m')]
    fig.axis.ticker.desired_num_ticks = 4
    return fig
