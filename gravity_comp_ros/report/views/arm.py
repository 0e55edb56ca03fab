"""The arm in three dimensions: its pose over time, each joint in the colour of its residual."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bokeh.events import Pan, PanStart
from bokeh.layouts import column, row
from bokeh.models import (
    ColorBar, ColumnDataSource, CustomJS, Div, LinearColorMapper, Range1d, Select, Slider,
    UIElement)
from bokeh.plotting import figure
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.report import css, markup
from gravity_comp_ros.report.arm import Arm, unvisited_poses
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import plot, Style
import numpy as np

_DRAW = Path(__file__).parents[1].joinpath('arm.js').read_text()
_ORBIT_BEGINS = 'plot.from_view = [azimuth.value, elevation.value]'
_ORBIT = """
const [turn, rise] = plot.from_view
const around = turn - 0.008 * cb_obj.delta_x
azimuth.value = Math.atan2(Math.sin(around), Math.cos(around))
elevation.value = Math.max(-0.5, Math.min(1.57, rise + 0.006 * cb_obj.delta_y))
"""
_POSES = 6
# The middle of the picture lies at this share of the reach above the base.
_MIDDLE = 0.45


def section(contents: Contents, table: Table, style: Style) -> Section | None:
    """Return the view; None where nothing says what the arm looks like."""
    arm = contents.arm
    if arm is None or not set(arm.geometry.joints) <= set(contents.joints):
        return None
    lead = markup.paragraph(
        'Each joint has the colour of its residual at the time of the slider, which a line marks '
        'in the plots over time. Drag to turn the view. Dots are where the tool was. An arc about '
        'each axis is its range: the thick part was visited, the thin part never was. The thin '
        'arm is a pose that is far from all that was visited: the model is a guess there.',
        'quiet') + markup.key([(style.up, 'visited'), (style.before, 'never visited'),
                               (style.marked, 'selected')])
    return Section('arm', 'The arm', lead, _view(contents, arm, table, style),
                   markup.folded('Ranges that were never visited',
                                 markup.bullets(_unvisited_words(contents, arm))))


def _view(contents: Contents, arm: Arm, table: Table, style: Style) -> UIElement:
    drawn = ColumnDataSource({name: [] for name in (
        'x0', 'y0', 'x1', 'y1', 'colour', 'alpha', 'width')})
    made = plot(style, '', '', '', 420, '', x_range=Range1d(-1, 1), y_range=Range1d(-1, 1))
    made.segment('x0', 'y0', 'x1', 'y1', source=drawn, line_color='colour', line_alpha='alpha',
                 line_width='width', line_cap='round')
    made.axis.visible = made.grid.visible = False
    made.toolbar_location = None
    numbers = [contents.model.joints.index(name) for name in arm.geometry.joints]
    rmse = np.sqrt((contents.residual[:, numbers] ** 2).mean(axis=0))
    colours = LinearColorMapper(palette=style.heat, low=0.0, high=max(2.0 * rmse.max(), 1e-9))
    made.add_layout(ColorBar(color_mapper=colours, width=12, title='|residual|, N·m',
                             title_text_color=style.text, major_label_text_color=style.text,
                             background_fill_color=style.background), 'right')
    told = Div(disable_math=True, sizing_mode='stretch_width',
               stylesheets=[css.CONTENT],
               styles={'color': 'var(--text)'})
    slider = _slider('time, s', 0.0, float(table.time.max()), 0.0, 0.01)
    azimuth = _slider('view around, rad', -3.14, 3.14, 0.6, 0.02)
    elevation = _slider('view from above, rad', -0.5, 1.57, 0.35, 0.02)
    ghost = Select(title='pose not yet visited', value='0', stylesheets=[css.CONTROL],
                   sizing_mode='stretch_width',
                   options=[(str(k), f'{k + 1}') for k in range(_POSES)] + [('-1', 'none')])
    looks = LinearColorMapper(palette=[style.faint, style.text, style.up, style.before,
                                       style.marked])
    draw = CustomJS(code=_DRAW, args={
        'samples': table.source, 'drawn': drawn, 'plot': made, 'slider': slider, 'told': told,
        'azimuth': azimuth, 'elevation': elevation, 'ghost': ghost, 'colours': colours,
        'looks': looks, 'cursor': table.cursor, 'arm': _numbers(contents, arm, numbers, rmse)})
    for model in (slider, azimuth, elevation, ghost):
        model.js_on_change('value', draw)
    # The first size is the first chance to draw.
    for size in ('inner_width', 'inner_height'):
        made.js_on_change(size, draw)
    table.source.selected.js_on_change('indices', draw)
    _orbit(made, azimuth, elevation)
    for one in (azimuth, elevation, ghost):
        one.styles = {'flex': '1 1 200px', 'width': 'auto'}
    below = row(azimuth, elevation, ghost, sizing_mode='stretch_width',
                styles={'flex-wrap': 'wrap'})
    return column(slider, made, below, told, sizing_mode='stretch_width')


def _numbers(contents: Contents, arm: Arm, numbers: list[int],
             rmse: FloatArray) -> dict[str, Any]:
    """Return what the drawing knows of the arm."""
    q = contents.samples.q[:, numbers]
    least, most = q.min(axis=0), q.max(axis=0)
    low, high = np.minimum(arm.low, least), np.maximum(arm.high, most)
    geometry = arm.geometry
    return {'origins': geometry.origins.tolist(), 'rotations': geometry.rotations.tolist(),
            'numbers': numbers, 'names': [markup.text(name) for name in geometry.joints],
            'usual': np.maximum(rmse, 1e-9).tolist(), 'reach': arm.reach,
            'middle': [0.0, 0.0, _MIDDLE * arm.reach],
            'ranges': np.column_stack([low, high, least, most]).tolist(),
            'unvisited': unvisited_poses(q, low, high, _POSES).tolist()}


def _orbit(made: figure, azimuth: Slider, elevation: Slider) -> None:
    args = {'plot': made, 'azimuth': azimuth, 'elevation': elevation}
    made.js_on_event(PanStart, CustomJS(args=args, code=_ORBIT_BEGINS))
    made.js_on_event(Pan, CustomJS(args=args, code=_ORBIT))


def _slider(title: str, start: float, end: float, value: float, step: float) -> Slider:
    return Slider(title=title, start=start, end=max(end, start + step), value=value, step=step,
                  sizing_mode='stretch_width', stylesheets=[css.CONTROL])


def _unvisited_words(contents: Contents, arm: Arm) -> list[str]:
    """Return in words which parts of the joints' ranges were never visited."""
    lines = []
    for k, name in enumerate(arm.geometry.joints):
        q = contents.samples.q[:, contents.model.joints.index(name)]
        parts = [f'{a:.2f} to {b:.2f}' for a, b in ((arm.low[k], q.min()), (q.max(), arm.high[k]))
                 if b > a]
        lines.append(f'{name}: {" and ".join(parts) or "none"}' + (' rad' if parts else ''))
    return lines
