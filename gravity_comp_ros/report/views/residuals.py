"""Residual against the joint's own speed, position and load, and against time."""

from __future__ import annotations

from bokeh.models import DataRange1d, LinearColorMapper, Span
from bokeh.plotting import figure
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import JointSelector, Section
from gravity_comp_ros.report.style import DOWN, FAINT, MARKED, plot, short, STILL, UP
from gravity_comp_ros.report.table import Table

_HEIGHT = 187
# Title and unit of the axis, by the letter of the column.
_AGAINST = {'v': ('own speed', 'rad/s'), 'q': ('own position', 'rad'),
            'p': ('own load (predicted)', 'N·m'), 't': ('time', 's')}


def section(contents: Contents, table: Table, selector: JointSelector) -> Section:
    """Return four plots per joint, coloured by the direction of motion."""
    def plots(k: int) -> list[figure]:
        common = DataRange1d(range_padding=0.06)
        return [against(contents, table, contents.numbers[k], letter, common, letter == 'v')
                for letter in _AGAINST]

    lead = markup.paragraph(
        'A correct model gives horizontal bands. A step at speed 0 indicates friction, a slope '
        'over speed viscous friction, over load a wrong gain or load-dependent friction, over '
        'position a spring or a missing term, over time a drift.', 'quiet')
    lead += markup.key([(UP, 'moving up'), (DOWN, 'moving down'), (STILL, 'at rest'),
                        (MARKED, 'selected')])
    return Section('residuals', 'Residual against speed, position, load and time', lead,
                   selector.place(plots, 200))


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
    fig = plot(heading, f'{title}, {unit}', 'residual, N·m' if is_first else '', _HEIGHT,
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
