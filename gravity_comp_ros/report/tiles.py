"""Rows of plots that wrap on a narrow page or in print."""

from __future__ import annotations

from collections.abc import Sequence

from bokeh.layouts import column, group_tools, row
from bokeh.models import GridPlot, Toolbar, ToolProxy, UIElement
from bokeh.models.tools import SaveTool
from bokeh.plotting import figure
from gravity_comp_ros.report import css

# The tools stay visible while the page scrolls.
_STICKY = {'position': 'sticky', 'top': '0', 'z-index': '5', 'background': 'var(--ground)',
           'border-bottom': '1px solid var(--line)'}

_NARROW = ':host { width: 100%; max-width: 100%; overflow-x: auto }' + css.TOOLS


def tiles(rows: Sequence[Sequence[figure]], min_width: int = 240) -> UIElement:
    """
    Return rows of plots with common tools above them.

    :param min_width: width in pixels below which a plot wraps to the next line.
    """
    plots = [plot for each in rows for plot in each]
    lines = []
    for each in rows:
        for plot in each:
            plot.toolbar_location = None
            plot.min_width = min(min_width, 240)
            plot.styles = {'flex': f'1 1 {min_width}px', 'width': 'auto',
                           'contain': 'layout style'}
        lines.append(row(*each, sizing_mode='stretch_width',
                         styles={'flex-wrap': 'wrap', 'break-inside': 'avoid'}))
    inside = column(*lines, sizing_mode='stretch_width')
    return GridPlot(children=[(inside, 0, 0)], toolbar=_toolbar(plots), toolbar_location='above',
                    sizing_mode='stretch_width')


def in_rows(plots: list[figure], columns: int) -> list[list[figure]]:
    """Return plots in rows of at most `columns`."""
    return [plots[k:k + columns] for k in range(0, len(plots), columns)]


def _toolbar(plots: list[figure]) -> Toolbar:
    """Return the common tools of all plots, each kind once."""
    active = next((plot.toolbar.active_drag for plot in plots
                   if plot.toolbar.active_drag not in ('auto', None)), None)
    tools = [tool for plot in plots for tool in plot.toolbar.tools]

    def merged(kind: type, group: list) -> SaveTool | None:
        return SaveTool() if issubclass(kind, SaveTool) else None

    grouped = group_tools(tools, merge=merged, ignore={'overlay', 'renderers', 'tooltips'})
    fig = Toolbar(tools=grouped, logo=None, styles=_STICKY, stylesheets=[_NARROW])
    for tool in grouped:
        if isinstance(tool, ToolProxy) and active in tool.tools:
            fig.active_drag = tool
    return fig
