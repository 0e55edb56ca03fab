"""The residuals of two models over the same time, side by side and on the same scale."""

from __future__ import annotations

from bokeh.models import ColumnDataSource, HoverTool, Span, UIElement
from bokeh.plotting import figure
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report.contents import plot_time
from gravity_comp_ros.report.decimate import keep_extremes
from gravity_comp_ros.report.style import padded, plot, short, Style
from gravity_comp_ros.report.tiles import tiles
from gravity_comp_ros.workbench.compare_view import Seen
import numpy as np

_HEIGHT, _AXIS = 120, 40
_TOOLS = 'pan,box_zoom,wheel_zoom,reset,save'


def residuals(a: Seen, b: Seen, samples: JointSamples, style: Style) -> UIElement | None:
    """
    Return the residual of each joint, A on the left and B on the right; None for no joint.

    :param samples: what both residuals are of, with the joints that both models have.
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
        most = float(max(np.abs(left[:, n]).max(), np.abs(right[:, n]).max(), 1e-9))
        scale = padded(-most, most)
        grid.append([_one(source, style, f'{letter.upper()}  {short(printable(joint), 30)}',
                          f'{letter}{n}', span, scale, n == len(joints) - 1)
                     for letter in 'ab'])
    return tiles(grid, 300)


def _one(source: ColumnDataSource, style: Style, title: str, column: str, span: object,
         scale: object, last: bool) -> figure:
    made = plot(style, title, 'time in s' if last else '', 'N·m', _HEIGHT + _AXIS * last, _TOOLS,
                x_range=span, y_range=scale)
    colour = style.before if column[0] == 'a' else style.after
    line = made.line('t', column, source=source, color=colour, line_width=1.0)
    made.add_layout(Span(location=0.0, dimension='width', line_color=style.faint, line_width=1))
    made.add_tools(HoverTool(renderers=[line], mode='vline', tooltips=[
        ('time', '@t{0.00} s'), ('residual', f'@{column}{{0.000}} N·m')]))
    made.xaxis.visible = last
    made.yaxis.ticker.desired_num_ticks = 4
    return made
