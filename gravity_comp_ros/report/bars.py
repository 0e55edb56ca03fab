"""Grouped bar plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bokeh.models import ColumnDataSource, FixedTicker
from bokeh.plotting import figure
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.style import label, plot

# Height of all bars of a group, and maximum height of a bar, relative to the group.
_FILLED, _MAX_THICKNESS = 0.78, 0.3
# Height in pixels of a group, and of the axis with its labels.
_GROUP, _AXIS = 36, 62


@dataclass(frozen=True)
class Bars:
    """One series of bars: name, value in each group, and colour."""

    name: str
    values: Sequence[float]
    colour: str


def bar_plot(unit: str, groups: Sequence[str], bars: Sequence[Bars], digits: str,
             max_name: int = 18) -> figure:
    """
    Return a plot with a group of bars for each name, the first group on top; see `bar_key`.

    :param unit: quantity and unit of the values, separated by a comma.
    :param digits: number format of the values.
    :param max_name: maximum length of a shown name.
    """
    count, step = len(groups), min(_FILLED / len(bars), _MAX_THICKNESS)
    # Groups are placed by number, because printable names may be identical.
    fig = plot('', unit, '', _AXIS + _GROUP * count, 'hover', y_range=(count - 0.45, -0.55))
    names = [label(name, 80) for name in groups]
    for place, series in enumerate(bars):
        shift = (place - 0.5 * (len(bars) - 1)) * step
        source = ColumnDataSource({
            'y': [k + shift for k in range(count)], 'right': list(series.values), 'name': names,
            'what': [label(series.name, 80)] * count})
        fig.hbar('y', right='right', height=0.9 * step, source=source, color=series.colour)
    fig.yaxis.ticker = FixedTicker(ticks=list(range(count)))
    fig.yaxis.major_label_overrides = {
        k: label(name, max_name) for k, name in enumerate(groups)}
    fig.ygrid.visible = False
    fig.x_range.start = 0.0
    fig.hover.tooltips = [('', '@name'), ('', '@what'),
                          (unit.split(',')[0], f'@right{{{digits}}}')]
    fig.toolbar_location = None
    return fig


def bar_key(bars: Sequence[Bars]) -> str:
    """Return the legend of bars as HTML."""
    return markup.key([(series.colour, series.name) for series in bars])
