"""Arm in three dimensions: pose over time, joints coloured by their residuals."""

from __future__ import annotations

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any

from bokeh.events import Pan, PanStart
from bokeh.layouts import column, row
from bokeh.models import (
    ColorBar, ColumnDataSource, CustomJS, Div, LinearColorMapper, Range1d, Select, Slider,
    UIElement)
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.robot_tree import position_limits
from gravity_comp_ros.description.urdf import find_description, parse_urdf
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.report import css, markup
from gravity_comp_ros.report.contents import Arm, Contents, Table
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.style import BEFORE, FAINT, HEAT, MARKED, plot, TEXT, UP
import numpy as np
from scipy.spatial.distance import cdist

_DRAW = Path(__file__).parents[1].joinpath('arm.js').read_text()
_ORBIT_BEGINS = 'plot.from_view = [azimuth.value, elevation.value]'
_ORBIT = """
const [turn, rise] = plot.from_view
const around = turn - 0.008 * cb_obj.delta_x
azimuth.value = Math.atan2(Math.sin(around), Math.cos(around))
elevation.value = Math.max(-0.5, Math.min(1.57, rise + 0.006 * cb_obj.delta_y))
"""
_POSES = 6
# Height of the centre of the view above the base, relative to the reach.
_MIDDLE = 0.45


# Maximum joint range of a drawing, in rad from zero.
_MAX_ANGLE = math.pi
_RANDOM_POSES, _MAX_VISITED = 2000, 500


def find_arm(paths: Sequence[Path], joints: Sequence[str], urdf: Path | None = None) -> Arm | None:
    """
    Return the arm of these joints, from a file or from the description in the recordings.

    Return None if the recordings have no description, or one of another robot.

    :param urdf: robot description to use instead of that of the recordings.
    :raises DataError: if this file is missing or not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    """
    try:
        description = find_description(urdf, paths)
        return None if description is None else described_arm(description.text, joints)
    except GravityCompError:
        if urdf is not None:
            raise
        return None


def described_arm(text: str | bytes, joints: Sequence[str]) -> Arm:
    """
    Return the arm of these joints.

    :raises DataError: if the text is not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    """
    geometry = parse_urdf(text, joints)
    low, high = position_limits(text, geometry.joints)
    return Arm(geometry, low.clip(-_MAX_ANGLE, _MAX_ANGLE), high.clip(-_MAX_ANGLE, _MAX_ANGLE))


def unvisited_poses(q: FloatArray, low: FloatArray, high: FloatArray, count: int) -> FloatArray:
    """
    Return poses (count, N) within the limits, far from all poses q (M, N) and from each other.

    Distances are relative to the range of each joint.
    """
    rng = np.random.default_rng(0)
    width = np.maximum(high - low, 1e-3)
    candidates = rng.uniform(0.0, 1.0, (_RANDOM_POSES, len(low)))
    visited = (q[::max(1, len(q) // _MAX_VISITED)] - low) / width
    distance = cdist(candidates, visited).min(axis=1)
    poses = np.zeros((count, len(low)))
    for pose in poses:
        pose[:] = candidates[distance.argmax()]
        distance = np.minimum(distance, np.linalg.norm(candidates - pose, axis=1))
    return low + width * poses


def section(contents: Contents, table: Table) -> Section | None:
    """Return the section; None without a robot description."""
    arm = contents.arm
    if arm is None or not set(arm.geometry.joints) <= set(contents.joints):
        return None
    lead = markup.paragraph(
        'The colour of each joint shows its residual at the time of the slider; a line marks this '
        'time in the plots over time. Drag to rotate the view. Dots are tool positions. The arc '
        'about each axis is the joint range: the thick part was visited, the thin part was not. '
        'The thin arm is a pose far from all visited poses, where the model extrapolates.',
        'quiet') + markup.key([(UP, 'visited'), (BEFORE, 'not visited'), (MARKED, 'selected')])
    return Section('arm', 'The arm', lead, _view(contents, arm, table),
                   markup.folded('Joint ranges that were not visited',
                                 markup.bullets(_unvisited_ranges(contents, arm))))


def _view(contents: Contents, arm: Arm, table: Table) -> UIElement:
    drawn = ColumnDataSource({name: [] for name in (
        'x0', 'y0', 'x1', 'y1', 'colour', 'alpha', 'width')})
    fig = plot('', '', '', 420, '', x_range=Range1d(-1, 1), y_range=Range1d(-1, 1))
    fig.segment('x0', 'y0', 'x1', 'y1', source=drawn, line_color='colour', line_alpha='alpha',
                line_width='width', line_cap='round')
    fig.axis.visible = fig.grid.visible = False
    fig.toolbar_location = None
    numbers = [contents.model.joints.index(name) for name in arm.geometry.joints]
    rmse = np.sqrt((contents.residual[:, numbers] ** 2).mean(axis=0))
    colours = LinearColorMapper(palette=HEAT, low=0.0, high=max(2.0 * rmse.max(), 1e-9))
    fig.add_layout(ColorBar(color_mapper=colours, width=12, title='|residual|, N·m'), 'right')
    pose_text = Div(disable_math=True, sizing_mode='stretch_width', stylesheets=[css.CONTENT],
                    styles={'color': 'var(--text)'})
    slider = _slider('time, s', 0.0, table.end, 0.0, 0.01)
    azimuth = _slider('azimuth of the view, rad', -3.14, 3.14, 0.6, 0.02)
    elevation = _slider('elevation of the view, rad', -0.5, 1.57, 0.35, 0.02)
    ghost = Select(title='unvisited pose', value='0', stylesheets=[css.CONTROL],
                   sizing_mode='stretch_width',
                   options=[(str(k), f'{k + 1}') for k in range(_POSES)] + [('-1', 'none')])
    draw = CustomJS(code=_DRAW, args={
        'samples': table.source, 'drawn': drawn, 'plot': fig, 'slider': slider,
        'pose_text': pose_text, 'azimuth': azimuth, 'elevation': elevation, 'ghost': ghost,
        'colours': colours, 'palette': [FAINT, TEXT, UP, BEFORE, MARKED], 'cursor': table.cursor,
        'arm': _arm_data(contents, arm, numbers, rmse)})
    for model in (slider, azimuth, elevation, ghost):
        model.js_on_change('value', draw)
    # The plot is drawn first when it gets a size.
    for size in ('inner_width', 'inner_height'):
        fig.js_on_change(size, draw)
    table.source.selected.js_on_change('indices', draw)
    view = {'plot': fig, 'azimuth': azimuth, 'elevation': elevation}
    fig.js_on_event(PanStart, CustomJS(args=view, code=_ORBIT_BEGINS))
    fig.js_on_event(Pan, CustomJS(args=view, code=_ORBIT))
    for control in (azimuth, elevation, ghost):
        control.styles = {'flex': '1 1 200px', 'width': 'auto'}
    below = row(azimuth, elevation, ghost, sizing_mode='stretch_width',
                styles={'flex-wrap': 'wrap'})
    return column(slider, fig, below, pose_text, sizing_mode='stretch_width')


def _arm_data(contents: Contents, arm: Arm, numbers: list[int],
              rmse: FloatArray) -> dict[str, Any]:
    """Return the data of the arm for the drawing script."""
    q = contents.samples.q[:, numbers]
    q_min, q_max = q.min(axis=0), q.max(axis=0)
    low, high = np.minimum(arm.low, q_min), np.maximum(arm.high, q_max)
    geometry = arm.geometry
    return {'origins': geometry.origins.tolist(), 'rotations': geometry.rotations.tolist(),
            'numbers': numbers, 'names': [markup.text(name) for name in geometry.joints],
            'rmse': np.maximum(rmse, 1e-9).tolist(), 'reach': arm.reach,
            'middle': [0.0, 0.0, _MIDDLE * arm.reach],
            'ranges': np.column_stack([low, high, q_min, q_max]).tolist(),
            'unvisited': unvisited_poses(q, low, high, _POSES).tolist()}


def _slider(title: str, start: float, end: float, value: float, step: float) -> Slider:
    return Slider(title=title, start=start, end=max(end, start + step), value=value, step=step,
                  sizing_mode='stretch_width', stylesheets=[css.CONTROL])


def _unvisited_ranges(contents: Contents, arm: Arm) -> list[str]:
    """Return a line for each joint with the unvisited parts of its range."""
    lines = []
    for k, name in enumerate(arm.geometry.joints):
        q = contents.samples.q[:, contents.model.joints.index(name)]
        parts = [f'{a:.2f} to {b:.2f}' for a, b in ((arm.low[k], q.min()), (q.max(), arm.high[k]))
                 if b > a]
        lines.append(f'{name}: {" and ".join(parts) or "none"}' + (' rad' if parts else ''))
    return lines
