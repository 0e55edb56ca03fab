"""Two values of each of some things, as pairs of bars."""

from __future__ import annotations

from collections.abc import Sequence

from bokeh.models import ColumnDataSource, FactorRange
from bokeh.plotting import figure
from bokeh.transform import dodge
from gravity_comp_ros.report.style import dress_legend, plot, Style


def pair_bars(style: Style, title: str, unit: str, height: int, names: Sequence[str],
              first: tuple[str, Sequence[float]], second: tuple[str, Sequence[float]],
              tips: list[tuple[str, str]]) -> figure:
    """
    Return a plot with two bars for each name, the first one above.

    :param first: label and values; so is `second`.
    :param tips: what hovering tells, of the columns `first` and `second`.
    """
    source = ColumnDataSource({'name': names, 'first': first[1], 'second': second[1]})
    made = plot(style, title, unit, '', height, 'hover', y_range=FactorRange(*names[::-1]))
    for column, offset, colour, label in (('first', 0.17, style.before, first[0]),
                                          ('second', -0.17, style.after, second[0])):
        made.hbar(dodge('name', offset, range=made.y_range), right=column, height=0.3,
                  source=source, color=colour, legend_label=label)
    made.x_range.start = 0.0
    made.ygrid.visible = False
    made.yaxis.major_tick_line_color = made.yaxis.separator_line_color = None
    made.hover.tooltips = tips
    made.add_layout(made.legend[0], 'above')
    made.toolbar_location = None
    dress_legend(made, style)
    return made
