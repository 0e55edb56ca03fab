"""Residual against the joint's own speed, position and load, and against time."""

from __future__ import annotations

from bokeh.models import DataRange1d, LinearColorMapper, Span
from bokeh.plotting import figure
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import plot, short, Style
from gravity_comp_ros.report.tiles import tiles

_HEIGHT, _AXIS = 165, 22
# Letter of the column, title and unit of the axis.
_AGAINST = (('v', 'own speed', 'rad/s'), ('q', 'own position', 'rad'),
            ('p', 'own load (predicted)', 'N·m'), ('t', 'time', 's'))


def section(contents: Contents, table: Table, style: Style) -> Section:
    """Return four plots per joint, coloured by the direction of motion."""
    colours = directions(style)
    rows = [[_scatter(table, style, n, k, colours, share, '' if k else contents.model.joints[n])
             for share in [own_range()] for k in range(len(_AGAINST))]
            for n in contents.numbers]
    grid = tiles(rows, 200)
    lead = markup.paragraph(
        'A correct model gives horizontal bands. A step at speed 0 indicates friction, a slope '
        'over speed viscous friction, over load a wrong gain or load-dependent friction, over '
        'position a spring or a missing term, over time a drift.', 'quiet')
    lead += markup.key([(style.up, 'moving up'), (style.down, 'moving down'),
                        (style.still, 'at rest'), (style.marked, 'selected')])
    return Section('residuals', 'Residual against speed, position, load and time', lead, grid)


def one(contents: Contents, table: Table, style: Style, joint: str, letter: str,
        height: int) -> figure:
    """Return one of these plots for a joint, against the column of a letter."""
    place = next(k for k, (name, _, _) in enumerate(_AGAINST) if name == letter)
    fig = _scatter(table, style, contents.model.joints.index(joint), place, directions(style),
                   own_range(), f'residual of {short(printable(joint), 24)}')
    fig.height = height
    fig.yaxis.axis_label = 'residual, N·m'
    return fig


def directions(style: Style) -> LinearColorMapper:
    """Return the colours of motion down, rest and motion up."""
    return LinearColorMapper(palette=[style.down, style.still, style.up], low=-1.5, high=1.5,
                             nan_color=style.background)


def own_range() -> DataRange1d:
    """Return a y range shared by one row of plots."""
    return DataRange1d(range_padding=0.06)


def _scatter(table: Table, style: Style, n: int, k: int, colours: LinearColorMapper,
             share: DataRange1d, name: str) -> figure:
    letter, title, unit = _AGAINST[k]
    x = 't' if letter == 't' else f'{letter}{n}'
    fig = plot(style, name, f'{title}, {unit}', '' if k else 'residual, N·m', _HEIGHT + _AXIS,
               y_range=share,
               tools='pan,box_zoom,wheel_zoom,box_select,lasso_select,tap,hover,reset,save')
    fig.scatter(x, f'r{n}', source=table.source, size=3, marker='square', line_color=None,
                fill_color={'field': f'd{n}', 'transform': colours}, fill_alpha=0.55,
                selection_fill_color=style.marked, selection_fill_alpha=0.95,
                nonselection_fill_alpha=0.12, nonselection_line_color=None,
                selection_line_color=None)
    fig.add_layout(Span(location=0.0, dimension='width', line_color=style.faint, line_width=1))
    fig.hover.tooltips = [(title, f'@{x}{{0.0000}} {unit}'), ('residual', f'@r{n}{{0.000}} N·m'),
                          ('time', '@t{0.00} s')]
    fig.xaxis.ticker.desired_num_ticks = 4
    fig.yaxis.ticker.desired_num_ticks = 4
    return fig
