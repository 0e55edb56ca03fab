"""Sections of the report, and the selector of the joint whose plots they show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from bokeh.layouts import column, group_tools, row
from bokeh.models import CustomJS, GridPlot, Select, Toolbar, ToolProxy, UIElement
from bokeh.models.tools import SaveTool
from bokeh.plotting import figure
from gravity_comp_ros.report import css
from gravity_comp_ros.report.style import label

ALL = 'all'
_SHOW = """
inside.children = lines.filter((_, k) => cb_obj.value == 'all' || cb_obj.value == String(k))
"""
# The tools stay visible while the page scrolls, below the selector. The dark style inverts white.
_STICKY = {'position': 'sticky', 'top': 'var(--top, 0)', 'z-index': '5',
           'background': 'white'}
_NARROW = ':host { width: 100%; max-width: 100%; overflow-x: auto }' + css.TOOLS


@dataclass(frozen=True)
class Section:
    """
    A titled section; `lead` and `after` are safe HTML before and after the plots.

    `key` is its name in links and file names.
    """

    key: str
    title: str
    lead: str = ''
    plots: UIElement | None = None
    after: str = ''


class JointSelector:
    """
    A drop-down list of joints: `place` shows the plots of one, or of all one below the other.

    In a report the browser exchanges the plots. On a server the page builds the place again.

    :param chosen: number of the joint shown first, or `ALL`.
    """

    def __init__(self, names: Sequence[str], chosen: str, served: bool = False) -> None:
        options = [(str(k), label(name, 60)) for k, name in enumerate(names)]
        self.select = Select(title='Plots of joint', value=chosen, width=260, name='joint',
                             options=[*options, (ALL, 'all joints')], stylesheets=[css.CONTROL],
                             visible=len(names) > 1)
        self._all, self._served = range(len(names)), served

    def place(self, make: Callable[[int], Sequence[figure]], min_width: int) -> UIElement:
        """
        Return the plots of the selected joint, with common tools above them.

        Only these are drawn.

        :param make: returns the plots of a joint by its number; they are in one row.
        :param min_width: width in pixels below which a plot wraps to the next line.
        """
        chosen = self.select.value
        selected = [k for k in self._all if chosen in (ALL, str(k))]
        plots = {k: make(k) for k in (selected if self._served else self._all)}
        lines = {k: _line(row, min_width) for k, row in plots.items()}
        inside = column(*(lines[k] for k in selected), sizing_mode='stretch_width')
        self.on_change(_SHOW, inside=inside, lines=list(lines.values()))
        return _with_tools(inside, [fig for row in plots.values() for fig in row])

    def on_change(self, code: str, **args: Any) -> None:
        """Run a script in the browser after a change, in a report."""
        if not self._served:
            self.select.js_on_change('value', CustomJS(code=code, args=args))


def tiles(plots: Sequence[figure], min_width: int) -> UIElement:
    """Return plots that wrap on a narrow page, with common tools above them."""
    return _with_tools(column(_line(plots, min_width), sizing_mode='stretch_width'), plots)


def _line(plots: Sequence[figure], min_width: int) -> UIElement:
    for fig in plots:
        fig.toolbar_location = None
        fig.min_width = min(min_width, 240)
        fig.styles = {'flex': f'1 1 {min_width}px', 'width': 'auto'}
    return row(*plots, sizing_mode='stretch_width',
               styles={'flex-wrap': 'wrap', 'break-inside': 'avoid'})


def _with_tools(inside: UIElement, plots: Sequence[figure]) -> UIElement:
    active = next((fig.toolbar.active_drag for fig in plots
                   if fig.toolbar.active_drag not in ('auto', None)), None)

    def merged(kind: type, group: list) -> SaveTool | None:
        return SaveTool() if issubclass(kind, SaveTool) else None

    grouped = group_tools([tool for fig in plots for tool in fig.toolbar.tools], merge=merged,
                          ignore={'overlay', 'renderers', 'tooltips'})
    tools = Toolbar(tools=grouped, logo=None, styles=_STICKY, stylesheets=[_NARROW])
    for tool in grouped:
        if isinstance(tool, ToolProxy) and active in tool.tools:
            tools.active_drag = tool
    return GridPlot(children=[(inside, 0, 0)], toolbar=tools, toolbar_location='above',
                    sizing_mode='stretch_width')
