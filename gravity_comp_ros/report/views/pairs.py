"""Residual and coverage over pairs of joints: grid and heat map."""

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import Any

from bokeh.models import (
    ColorBar, ColumnDataSource, CustomJS, FixedTicker, LinearColorMapper, Range1d, Select)
from bokeh.plotting import figure
from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents, REPORT
from gravity_comp_ros.report.section import Section, tiles
from gravity_comp_ros.report.style import GRID, HEAT, label, plot
import numpy as np
from numpy.typing import NDArray

_CELLS = 12


def cell_edges(q: FloatArray, cells: int = _CELLS) -> FloatArray:
    """Return edges (N, cells + 1) in rad that divide the range of each joint of q (M, N)."""
    low, high = q.min(axis=0), q.max(axis=0)
    half, middle = 0.5 * np.maximum(high - low, REPORT.min_travel), 0.5 * (low + high)
    return np.linspace(middle - half, middle + half, cells + 1).T


def places(q: FloatArray, edges: FloatArray) -> IntArray:
    """Return the cell index (M, N) of each pose (M, N) along each joint."""
    indices = [np.searchsorted(edge, angle, side='right') - 1 for edge, angle in zip(edges, q.T)]
    return np.clip(np.column_stack(indices), 0, edges.shape[1] - 2).astype(np.int64)


def pair_cells(place: IntArray, residual: FloatArray, cells: int) -> dict[str, NDArray[Any]]:
    """
    Return the K visited cells of all pairs i <= j of N joints, as columns (K,).

    `i` and `j` are the joints of a cell, `a` and `b` its indices along them, `count` its number
    of samples, and `e0`, `e1`, ... the RMS residual of each joint in N·m.

    :param place: cell indices (M, N).
    :param residual: (M, N) in N·m.
    """
    squares, parts = residual.T ** 2, []
    for i, j in combinations_with_replacement(range(place.shape[1]), 2):
        cell = place[:, i] * cells + place[:, j]
        count = np.bincount(cell)
        filled = np.flatnonzero(count)
        sums = np.array([np.bincount(cell, square)[filled] for square in squares])
        parts.append(np.vstack([np.full(len(filled), i), np.full(len(filled), j),
                                *np.divmod(filled, cells), count[filled],
                                np.sqrt(sums / count[filled])]))
    numbers = np.hstack(parts)
    whole = dict(zip('ijab', numbers.astype(np.int32))) | {'count': numbers[4].astype(np.int32)}
    return whole | {f'e{k}': rms.astype(np.float32) for k, rms in enumerate(numbers[5:])}


_GAP = 0.06
_TOOLS = 'hover,reset,save'

_SHOW_JOINT = """
if (cb_obj.value == 'all') return
const rms = cells.get_column('e' + cb_obj.value)
colours.high = Math.max(...rms, 1e-9)
title.text = titles[cb_obj.value]
cells.data = {...cells.data, shown: rms}
"""


def section(contents: Contents, selector: Select) -> Section:
    """Return the residual of the selected joint over all pairs."""
    numbers, names = contents.numbers, contents.joints
    q = contents.samples.q[:, numbers]
    edges = cell_edges(q)
    visited = pair_cells(places(q, edges), contents.residual[:, numbers], _CELLS)
    joint = int(selector.value)
    cells = ColumnDataSource(visited | _rectangles(visited, edges)
                             | {'shown': visited[f'e{joint}']})
    colours = LinearColorMapper(palette=HEAT, low=0.0,
                                high=float(visited[f'e{joint}'].max()) or 1e-9)
    titles = [label(f'residual of {name}, RMS in N·m', 60) for name in names]
    fig = _matrix(titles[joint], names, cells, colours)
    selector.js_on_change('value', CustomJS(code=_SHOW_JOINT, args={
        'cells': cells, 'colours': colours, 'title': fig.title, 'titles': titles}))
    lead = markup.paragraph(
        'Each block is a pair of joints, each cell a part of their ranges; the diagonal shows '
        'single joints. Cells without colour were not visited: the model extrapolates there.',
        'quiet')
    return Section('pairs', 'Pairs of joints', lead, tiles([fig], 300))


def _rectangles(cells: dict[str, NDArray[Any]], edges: FloatArray) -> dict[str, NDArray[Any]]:
    """Return the place and the angles of cells, first joint to the right, second joint up."""
    first, second, column, row = (cells[name] for name in 'ijab')
    n, width = len(edges), (1.0 - _GAP) / (edges.shape[1] - 1)
    # Cells on the diagonal are bars over the height of the block.
    is_own = first == second
    begin = first + _GAP / 2 + column * width
    bottom = n - 1 - second + _GAP / 2 + np.where(is_own, 0, row) * width
    top = np.where(is_own, n - second - _GAP / 2, bottom + width)
    middle = 0.5 * (edges[:, 1:] + edges[:, :-1])
    columns = {'left': begin, 'right': begin + width, 'bottom': bottom, 'top': top,
               'x': middle[first, column], 'y': middle[second, row]}
    return {name: values.astype(np.float32) for name, values in columns.items()}


def _matrix(title: str, names: tuple[str, ...], cells: ColumnDataSource,
            colours: LinearColorMapper) -> figure:
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
                     fill_color={'field': 'shown', 'transform': colours})
    fig.hover.renderers = [drawn]
    fig.hover.tooltips = [
        ('joint at the bottom', '@x{0.00} rad'), ('joint at the left', '@y{0.00} rad'),
        ('RMS', '@shown{0.000} N·m'), ('samples', '@count')]
    ticks = [k + 0.5 for k in range(n)]
    labels = [label(name) for name in names]
    fig.xaxis.ticker = fig.yaxis.ticker = FixedTicker(ticks=ticks)
    fig.xaxis.major_label_overrides = dict(zip(ticks, labels))
    fig.yaxis.major_label_overrides = dict(zip(ticks, labels[::-1]))
    if max(len(name) for name in names) * n > 40:
        fig.xaxis.major_label_orientation = 0.8
    fig.add_layout(ColorBar(color_mapper=colours, width=12, padding=6), 'right')
    return fig
