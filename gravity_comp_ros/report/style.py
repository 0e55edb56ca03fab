"""Colours and common style of the plots, light and dark."""

from __future__ import annotations

from dataclasses import dataclass
import re
from typing import Any

from bokeh.models import BoxSelectTool, Range1d, WheelZoomTool
from bokeh.palettes import Cividis256
from bokeh.plotting import figure
from gravity_comp_ros.report import css

# Okabe and Ito's colours, distinguishable with any common colour blindness.
BLUE, SKY, GREEN, ORANGE = '#0072b2', '#56b4e9', '#009e73', '#e69f00'
VERMILION, PURPLE, YELLOW = '#d55e00', '#cc79a7', '#b8a800'

# Maximum length of a title on a narrow page.
_MAX_TITLE = 38

TOOLS = 'pan,box_zoom,wheel_zoom,box_select,lasso_select,tap,reset,save'


@dataclass(frozen=True)
class Style:
    """Colours of a plot."""

    name: str
    background: str
    text: str
    faint: str
    grid: str
    measured: str
    predicted: str
    other: str
    residual: str
    up: str
    down: str
    still: str
    marked: str
    before: str
    after: str
    never: str

    @property
    def heat(self) -> list[str]:
        """Return the palette from small to large values; large values have high contrast."""
        return list(Cividis256 if self.name == 'dark' else Cividis256[::-1])


LIGHT = Style('light', '#ffffff', '#1b1f24', '#59636e', '#e3e6ea', '#1b1f24', ORANGE, PURPLE,
              BLUE, BLUE, VERMILION, '#8a8f98', '#c4007a', '#a9b0b9', BLUE, '#f3f4f6')
DARK = Style('dark', '#14181d', '#e8eaed', '#a4abb5', '#2c333b', '#e8eaed', ORANGE, PURPLE,
             SKY, SKY, '#ff8c42', '#7f8792', '#ff5fb8', '#6b7480', SKY, '#1d232a')


def canvas_text(text: str) -> str:
    """Return text for titles and axes without formula delimiters of Bokeh."""
    return re.sub(r'\$(?=\$)', '$ ', text).replace(r'\(', r'\ (').replace(r'\[', r'\ [')


def plot(style: Style, title: str, x: str, y: str, height: int = 180, tools: str = TOOLS,
         **more: Any) -> figure:
    """
    Return an empty figure in the common style.

    :param x: label of the x axis with its unit; likewise `y`; empty for none.
    """
    label = canvas_text(short(title, _MAX_TITLE))
    fig = figure(height=height, sizing_mode='stretch_width', tools=tools, min_width=120,
                 title=label or None, x_axis_label=canvas_text(x) or None,
                 y_axis_label=canvas_text(y) or None, **more)
    fig.toolbar.logo = None
    # The tools are visible; a menu would add a tenth to the drawing time of a plot.
    fig.context_menu = None
    fig.stylesheets = [css.PLOT]
    fig.toolbar.stylesheets = [css.TOOLS]
    wheel = fig.select_one(WheelZoomTool)
    if wheel is not None:
        # Over an axis the wheel zooms that axis only; without Ctrl it scrolls the page.
        wheel.modifiers = {'ctrl': True}
        fig.toolbar.active_scroll = wheel
    fig.toolbar.autohide = False
    box = fig.select_one(BoxSelectTool)
    if box is not None:
        fig.toolbar.active_drag = box
    restyle(fig, style)
    return fig


def restyle(fig: figure, style: Style) -> None:
    """Apply colours and font sizes to a figure."""
    fig.background_fill_color = fig.border_fill_color = style.background
    fig.outline_line_color = style.grid
    if fig.title is not None:
        fig.title.text_color = style.text
        fig.title.text_font_size = '13px'
        fig.title.text_font_style = 'normal'
    for axis in fig.axis:
        axis.axis_label_text_color = axis.major_label_text_color = style.text
        axis.axis_label_text_font_size = axis.major_label_text_font_size = '12px'
        axis.axis_label_text_font_style = 'normal'
        axis.axis_line_color = axis.major_tick_line_color = style.faint
        axis.minor_tick_line_color = None
    fig.grid.grid_line_color = style.grid


def padded(low: float, high: float, share: float = 0.05) -> Range1d:
    """Return a fixed range with a margin of `share` of its width."""
    margin = share * (high - low) or max(0.05 * abs(high), 1e-3)
    return Range1d(low - margin, high + margin)


def short(text: str, max_length: int = 18) -> str:
    """Return a long name with its middle omitted, because joint names differ at the ends."""
    if len(text) <= max_length:
        return text
    head = (max_length - 1) // 2
    return f'{text[:head]}…{text[len(text) - (max_length - 1 - head):]}'


def dress_legend(fig: figure, style: Style) -> None:
    """Apply the style to a figure's legend."""
    fig.legend.label_text_color = style.text
    fig.legend.label_text_font_size = '12px'
    fig.legend.background_fill_color = style.background
    fig.legend.background_fill_alpha = 0.8
    fig.legend.border_line_color = None
    fig.legend.padding = fig.legend.margin = 4
    fig.legend.spacing = 1
