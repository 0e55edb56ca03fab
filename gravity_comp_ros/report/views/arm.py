"""Arm in three dimensions: pose over time, joints coloured by their residuals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bokeh.events import Pan, PanStart
from bokeh.layouts import column, row
from bokeh.models import (
    ColorBar, ColumnDataSource, CustomJS, Div, LinearColorMapper, Range1d, Slider, UIElement)
from gravity_comp_ros.description.links import DescribedArm
from gravity_comp_ros.description.robot_tree import find_description
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.report import css, markup
from gravity_comp_ros.report.contents import Contents, Table
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.style import FAINT, HEAT, MARKED, plot, TEXT, UP
import numpy as np

_DRAW = Path(__file__).parents[1].joinpath('arm.js').read_text()
_ORBIT_BEGINS = 'plot.from_view = [azimuth.value, elevation.value]'
_ORBIT = """
const [turn, rise] = plot.from_view
const around = turn - 0.008 * cb_obj.delta_x
azimuth.value = Math.atan2(Math.sin(around), Math.cos(around))
elevation.value = Math.max(-0.5, Math.min(1.57, rise + 0.006 * cb_obj.delta_y))
"""
# Height of the centre of the view above the base, relative to the reach.
_MIDDLE = 0.45


def find_arm(paths: Sequence[Path], joints: Sequence[str],
             urdf: Path | None = None) -> Geometry | None:
    """
    Return the axes of these joints, from a file or from the description in the recordings.

    Return None if the recordings have no description, or one of another robot.

    :param urdf: robot description to use instead of that of the recordings.
    :raises DataError: if this file is missing or not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    """
    try:
        description = find_description(urdf, paths)
        return None if description is None else DescribedArm(description, joints).geometry
    except GravityCompError:
        if urdf is not None:
            raise
        return None


def section(contents: Contents, table: Table) -> Section:
    """Return the section, a text without plots if there is no robot description."""
    arm = contents.arm
    if arm is None or not set(arm.joints) <= set(contents.joints):
        return Section('arm', 'The arm', markup.paragraph(
            'No recording contains a /robot_description of these joints: name a file with --urdf '
            'to show the arm.', 'quiet'))
    lead = markup.paragraph(
        'The colour of each joint shows its residual at the time of the slider; a line marks this '
        'time in the plots over time. Drag to rotate the view. Dots are tool positions.',
        'quiet') + markup.key([(UP, 'all samples'), (MARKED, 'selected samples')])
    return Section('arm', 'The arm', lead, _view(contents, arm, table))


def _view(contents: Contents, arm: Geometry, table: Table) -> UIElement:
    links, joints, floor, visited, marked = (
        ColumnDataSource({'x': [], 'y': [], **({'error': []} if k == 1 else {})})
        for k in range(5))
    numbers = [contents.model.joints.index(name) for name in arm.joints]
    rmse = np.sqrt((contents.residual[:, numbers] ** 2).mean(axis=0))
    colours = LinearColorMapper(palette=HEAT, low=0.0, high=max(2.0 * rmse.max(), 1e-9))
    fig = plot('', '', '', 420, '', x_range=Range1d(-1, 1), y_range=Range1d(-1, 1))
    fig.line(source=floor, color=FAINT, line_alpha=0.35)
    fig.line(source=links, color=FAINT, line_width=9, line_cap='round', line_join='round')
    fig.scatter(source=joints, size=20, line_color=TEXT,
                fill_color={'field': 'error', 'transform': colours})
    for source, colour in ((visited, UP), (marked, MARKED)):
        fig.scatter(source=source, size=4, color=colour, alpha=0.6)
    fig.axis.visible = fig.grid.visible = False
    fig.toolbar_location = None
    fig.add_layout(ColorBar(color_mapper=colours, width=12, title='|residual|, N·m'), 'right')
    pose_text = Div(disable_math=True, sizing_mode='stretch_width', stylesheets=[css.CONTENT],
                    styles={'color': 'var(--text)'})
    slider = _slider('time, s', 0.0, table.end, 0.0, 0.01)
    azimuth = _slider('azimuth of the view, rad', -3.14, 3.14, 0.6, 0.02)
    elevation = _slider('elevation of the view, rad', -0.5, 1.57, 0.35, 0.02)
    # Of the stretched arm, in m.
    reach = max(float(np.linalg.norm(arm.origins, axis=1).sum()), 1e-3)
    draw = CustomJS(code=_DRAW, args={
        'samples': table.source, 'links': links, 'joints': joints, 'floor': floor,
        'visited': visited, 'marked': marked, 'plot': fig, 'slider': slider,
        'pose_text': pose_text, 'azimuth': azimuth, 'elevation': elevation,
        'cursor': table.cursor,
        'arm': {'origins': arm.origins.tolist(), 'rotations': arm.rotations.tolist(),
                'numbers': numbers, 'names': [markup.text(name) for name in arm.joints],
                'reach': reach, 'middle': [0.0, 0.0, _MIDDLE * reach]}})
    for model in (slider, azimuth, elevation):
        model.js_on_change('value', draw)
    # The plot is drawn first when it gets a size.
    for size in ('inner_width', 'inner_height'):
        fig.js_on_change(size, draw)
    table.source.selected.js_on_change('indices', draw)
    view = {'plot': fig, 'azimuth': azimuth, 'elevation': elevation}
    fig.js_on_event(PanStart, CustomJS(args=view, code=_ORBIT_BEGINS))
    fig.js_on_event(Pan, CustomJS(args=view, code=_ORBIT))
    for control in (azimuth, elevation):
        control.styles = {'flex': '1 1 200px', 'width': 'auto'}
    below = row(azimuth, elevation, sizing_mode='stretch_width', styles={'flex-wrap': 'wrap'})
    return column(slider, fig, below, pose_text, sizing_mode='stretch_width')


def _slider(title: str, start: float, end: float, value: float, step: float) -> Slider:
    return Slider(title=title, start=start, end=max(end, start + step), value=value, step=step,
                  sizing_mode='stretch_width', stylesheets=[css.CONTROL])
