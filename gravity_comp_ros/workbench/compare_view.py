"""Comparison of two models on the same samples: provenance, effects, errors and residuals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bokeh.layouts import column, gridplot
from bokeh.models import ColumnDataSource, HoverTool, Span, UIElement
from bokeh.plotting import figure
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.diagnosis.wording import percent
from gravity_comp_ros.display import change
from gravity_comp_ros.evaluation.compare import Comparison
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.bars import bar_key, bar_plot, Bars
from gravity_comp_ros.report.contents import plot_time
from gravity_comp_ros.report.decimate import keep_extremes
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.style import padded, plot, short, Style
from gravity_comp_ros.report.tiles import tiles
from gravity_comp_ros.report.views.equations import numbers
import numpy as np

_HEIGHT, _AXIS = 120, 40
_TOOLS = 'pan,box_zoom,wheel_zoom,reset,save'


@dataclass(frozen=True, eq=False)
class ComparedModel:
    """
    A model in the comparison.

    `facts` are rows on its provenance, `comparison` its errors on the selected samples,
    `residual` (M, N) in N·m its residual on all chosen samples.
    """

    name: str
    model: GravityModel
    facts: Mapping[str, str]
    comparison: Comparison
    residual: FloatArray


def section(a: ComparedModel, b: ComparedModel, plots: UIElement | None, style: Style) -> Section:
    """Return the comparison of two models; `plots` are their residuals."""
    joints = [joint for joint in b.comparison.joints if joint in a.comparison.joints]
    lead = markup.paragraph(f'A is {a.name}, B is {b.name}. Errors are on the selected samples.',
                            'quiet')
    lead += _contents_table(a, b) + _error_table(joints, a.comparison, b.comparison)
    # A separate grid, because Bokeh lays out a plot next to a grid incorrectly.
    bars = _bars(joints, a, b, style)
    fig = bar_plot(style, 'RMSE of both models', 'RMSE, N·m', 90 + 34 * len(joints), joints, bars,
                   '0.0000')
    parts: list[UIElement] = [gridplot([[fig]], sizing_mode='stretch_width',
                                       toolbar_location=None)]
    if plots is not None:
        parts.append(plots)
    return Section('compare', f'{b.name} against {a.name}', lead + bar_key(bars),
                   column(*parts, sizing_mode='stretch_width'))


def _contents_table(a: ComparedModel, b: ComparedModel) -> str:
    """Return a table of the provenance and the effects of both models."""
    rows = [[what, a.facts[what], b.facts[what]] for what in a.facts
            if a.facts[what] or b.facts[what]]
    of_b, of_a = ({effect.target: numbers(effect) for effect in seen.model.applied.effects}
                  for seen in (b, a))
    rows += [[target, of_a.get(target, 'not included'), of_b.get(target, 'not included')]
             for target in dict.fromkeys([*of_a, *of_b])]
    return markup.table(['', 'A', 'B'], rows, left=('A', 'B'))


def _error_table(joints: list[str], a: Comparison, b: Comparison) -> str:
    rows = []
    for joint in joints:
        x, y = a.joints[joint], b.joints[joint]
        rows.append([joint, f'{x.rmse:.4f}', f'{y.rmse:.4f}', change(x.rmse, y.rmse),
                     percent(x.nrmse), percent(y.nrmse), f'{x.max_abs:.3f}', f'{y.max_abs:.3f}'])
    return markup.table(
        ['joint', 'RMSE N·m, A', 'RMSE N·m, B', 'change', 'nRMSE, A', 'nRMSE, B',
         'largest N·m, A', 'largest N·m, B'], rows)


def _bars(joints: list[str], a: ComparedModel, b: ComparedModel, style: Style) -> list[Bars]:
    return [Bars(f'{letter}: {short(seen.name, 44)}',
                 [seen.comparison.joints[joint].rmse for joint in joints], colour)
            for letter, seen, colour in (('A', a, style.before), ('B', b, style.after))]


def residuals(a: ComparedModel, b: ComparedModel, samples: JointSamples, style: Style
              ) -> UIElement | None:
    """
    Return plots of the residual of each joint, A left and B right; None without joints.

    :param samples: samples of both residuals, with the joints that both models have.
    """
    joints = samples.names
    if not joints or not samples.n_samples:
        return None
    left, right = (seen.residual[:, [seen.model.joints.index(name) for name in joints]]
                   for seen in (a, b))
    time, _ = plot_time(samples)
    rows, _ = keep_extremes(samples.runs, np.hstack([left, right]))
    ends = np.flatnonzero(np.diff(samples.runs[rows]) > 0) + 1
    data = {'t': np.insert(time[rows], ends, np.nan)}
    for n in range(len(joints)):
        data |= {f'a{n}': np.insert(left[rows, n], ends, np.nan),
                 f'b{n}': np.insert(right[rows, n], ends, np.nan)}
    source = ColumnDataSource({name: x.astype(np.float32) for name, x in data.items()})
    span = padded(0.0, float(time.max()), 0.01)
    grid = []
    for n, joint in enumerate(joints):
        limit = float(max(np.abs(left[:, n]).max(), np.abs(right[:, n]).max(), 1e-9))
        scale = padded(-limit, limit)
        grid.append([_plot(source, style, f'{letter.upper()}  {short(printable(joint), 30)}',
                           f'{letter}{n}', span, scale, n == len(joints) - 1)
                     for letter in 'ab'])
    return tiles(grid, 300)


def _plot(source: ColumnDataSource, style: Style, title: str, column: str, span: object,
          scale: object, last: bool) -> figure:
    fig = plot(style, title, 'time in s' if last else '', 'N·m', _HEIGHT + _AXIS * last, _TOOLS,
               x_range=span, y_range=scale)
    colour = style.before if column[0] == 'a' else style.after
    line = fig.line('t', column, source=source, color=colour, line_width=1.0)
    fig.add_layout(Span(location=0.0, dimension='width', line_color=style.faint, line_width=1))
    fig.add_tools(HoverTool(renderers=[line], mode='vline', tooltips=[
        ('time', '@t{0.00} s'), ('residual', f'@{column}{{0.000}} N·m')]))
    fig.xaxis.visible = last
    fig.yaxis.ticker.desired_num_ticks = 4
    return fig
