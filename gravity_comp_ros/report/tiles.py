"""Plots side by side where there is room, below each other on a narrow page or on paper."""

from __future__ import annotations

from collections.abc import Sequence

from bokeh.layouts import column, group_tools, row
from bokeh.models import GridPlot, Toolbar, ToolProxy, UIElement
from bokeh.models.tools import SaveTool
from bokeh.plotting import figure
from gravity_comp_ros.report import css

# The tools stay in sight however far down its plots one scrolls.
_AT_HAND = {'position': 'sticky', 'top': '0', 'z-index': '5', 'background': 'var(--ground)',
            'border-bottom': '1px solid var(--line)'}

_NARROW = ':host { width: 100%; max-width: 100%; overflow-x: auto }' + css.TOOLS


def tiles(rows: Sequence[Sequence[figure]], least: int = 240) -> UIElement:
    """
    Return rows of plots with common tools above them.

    :param least: width in pixels below which a plot goes below its neighbour.
    """
    plots = [plot for each in rows for plot in each]
    lines = []
    for each in rows:
        for plot in each:
            plot.toolbar_location = None
            plot.min_width = min(least, 240)
            plot.styles = {'flex': f'1 1 {least}px', 'width': 'auto', 'contain': 'layout style'}
        lines.append(row(*each, sizing_mode='stretch_width',
                         styles={'flex-wrap': 'wrap', 'break-inside': 'avoid'}))
    inside = column(*lines, sizing_mode='stretch_width')
    return GridPlot(children=[(inside, 0, 0)], toolbar=_toolbar(plots), toolbar_location='above',
                    sizing_mode='stretch_width')


def _toolbar(plots: list[figure]) -> Toolbar:
    """Return the tools of all plots, each kind once."""
    active = next((plot.toolbar.active_drag for plot in plots
                   if plot.toolbar.active_drag not in ('auto', None)), None)
    tools = [tool for plot in plots for tool in plot.toolbar.tools]

    def merged(kind: type, group: list) -> SaveTool | None:
        return SaveTool() if issubclass(kind, SaveTool) else None

    grouped = group_tools(tools, merge=merged, ignore={'overlay', 'renderers', 'tooltips'})
    made = Toolbar(tools=grouped, logo=None, styles=_AT_HAND, stylesheets=[_NARROW])
    for tool in grouped:
        if isinstance(tool, ToolProxy) and active in tool.tools:
            made.active_drag = tool
    return made
