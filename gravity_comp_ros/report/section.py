"""Sections of the report, and the selector of the joint whose plots they show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from bokeh.layouts import column, group_tools, row
from bokeh.models import CustomJS, GridPlot, Select, Toolbar, ToolProxy, UIElement
from bokeh.models.tools import SaveTool
from bokeh.plotting import figure
from gravity_comp_ros.report import css
from gravity_comp_ros.report.style import label

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


def joint_selector(names: Sequence[str], chosen: str) -> Select:
    """Return a drop-down list of joints, for `by_joint`; `chosen` is the one shown first."""
    options = [(str(k), label(name, 60)) for k, name in enumerate(names)]
    return Select(title='Plots of joint', value=str(names.index(chosen)), width=260, name='joint',
                  options=[*options, ('all', 'all joints')], stylesheets=[css.CONTROL],
                  visible=len(names) > 1)


def by_joint(select: Select, make: Callable[[int], Sequence[figure]],
             min_width: int) -> UIElement:
    """
    Return the plots of the selected joint, or of all one below the other, with common tools.

    The browser exchanges the plots; only those of the selected joint are drawn.

    :param make: returns the plots of a joint by its number; they are in one row.
    :param min_width: width in pixels below which a plot wraps to the next line.
    """
    plots = [make(k) for k in range(len(select.options) - 1)]
    lines = [_line(figures, min_width) for figures in plots]
    inside = column(lines[int(select.value)], sizing_mode='stretch_width')
    select.js_on_change('value', CustomJS(code=_SHOW, args={'inside': inside, 'lines': lines}))
    return _with_tools(inside, [fig for figures in plots for fig in figures])


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
