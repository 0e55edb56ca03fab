"""Several values of each of some things, as groups of bars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bokeh.models import ColumnDataSource, FixedTicker
from bokeh.plotting import figure
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.style import canvas_text, plot, short, Style

# Of a group, which is 1 high.
_FILLED, _THICKEST = 0.78, 0.3


@dataclass(frozen=True)
class Bars:
    """What one bar of every group stands for, its value in each group, and its colour."""

    name: str
    values: Sequence[float]
    colour: str


def bar_plot(style: Style, title: str, unit: str, height: int, groups: Sequence[str],
             bars: Sequence[Bars], digits: str, longest: int = 18) -> figure:
    """
    Return a plot with a group of bars for each name, the first one above; `bar_key` explains it.

    :param unit: what the values are, and their unit.
    :param digits: the format of a value.
    :param longest: how many letters of a name have room.
    """
    count, step = len(groups), min(_FILLED / len(bars), _THICKEST)
    # Names may be alike once they are printable, so groups stand at numbers.
    made = plot(style, title, unit, '', height, 'hover', y_range=(count - 0.45, -0.55))
    names = [canvas_text(printable(name)) for name in groups]
    for place, one in enumerate(bars):
        shift = (place - 0.5 * (len(bars) - 1)) * step
        source = ColumnDataSource({
            'y': [k + shift for k in range(count)], 'right': list(one.values), 'name': names,
            'what': [canvas_text(printable(one.name))] * count})
        made.hbar('y', right='right', height=0.9 * step, source=source, color=one.colour)
    made.yaxis.ticker = FixedTicker(ticks=list(range(count)))
    made.yaxis.major_label_overrides = {
        k: canvas_text(short(printable(name), longest)) for k, name in enumerate(groups)}
    made.ygrid.visible = False
    made.x_range.start = 0.0
    made.hover.tooltips = [('', '@name'), ('', '@what'),
                           (unit.split(',')[0], f'@right{{{digits}}}')]
    made.toolbar_location = None
    return made


def bar_key(bars: Sequence[Bars]) -> str:
    """Return what the colours of bars stand for, as HTML."""
    return markup.key([(one.colour, one.name) for one in bars])
