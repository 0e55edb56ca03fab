"""Colours and the plots' common looks, light and dark."""

from __future__ import annotations

from dataclasses import dataclass
import re
from typing import Any

from bokeh.models import BoxSelectTool, Range1d, WheelZoomTool
from bokeh.palettes import Cividis256
from bokeh.plotting import figure
from gravity_comp_ros.report import css

# Okabe and Ito's colours, which people with any common colour blindness tell apart.
BLUE, SKY, GREEN, ORANGE = '#0072b2', '#56b4e9', '#009e73', '#e69f00'
VERMILION, PURPLE, YELLOW = '#d55e00', '#cc79a7', '#b8a800'

# A longer title would be wider than a narrow page.
_LONGEST_TITLE = 38

TOOLS = 'pan,box_zoom,wheel_zoom,box_select,lasso_select,tap,reset,save'


@dataclass(frozen=True)
class Style:
    """What things are drawn in."""

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
        """Return colours from small to large; large is what stands out."""
        return list(Cividis256 if self.name == 'dark' else Cividis256[::-1])


LIGHT = Style('light', '#ffffff', '#1b1f24', '#59636e', '#e3e6ea', '#1b1f24', ORANGE, PURPLE,
              BLUE, BLUE, VERMILION, '#8a8f98', '#c4007a', '#a9b0b9', BLUE, '#f3f4f6')
DARK = Style('dark', '#14181d', '#e8eaed', '#a4abb5', '#2c333b', '#e8eaed', ORANGE, PURPLE,
             SKY, SKY, '#ff8c42', '#7f8792', '#ff5fb8', '#6b7480', SKY, '#1d232a')


def canvas_text(text: str) -> str:
    """Return text for titles and axes, in which Bokeh must see no formula."""
    return re.sub(r'\$(?=\$)', '$ ', text).replace(r'\(', r'\ (').replace(r'\[', r'\ [')


def plot(style: Style, title: str, x: str, y: str, height: int = 180, tools: str = TOOLS,
         **more: Any) -> figure:
    """
    Return an empty figure in the common looks.

    :param x: label of the x axis with its unit, as `y`; empty for none.
    """
    shown = canvas_text(short(title, _LONGEST_TITLE))
    made = figure(height=height, sizing_mode='stretch_width', tools=tools, min_width=120,
                  title=shown or None, x_axis_label=canvas_text(x) or None,
                  y_axis_label=canvas_text(y) or None, **more)
    made.toolbar.logo = None
    # Its tools are in sight; a menu of them as well costs a tenth of the time of a plot.
    made.context_menu = None
    made.stylesheets = [css.PLOT]
    made.toolbar.stylesheets = [css.TOOLS]
    wheel = made.select_one(WheelZoomTool)
    if wheel is not None:
        # Over an axis the wheel zooms that axis alone; without Ctrl it scrolls the page.
        wheel.modifiers = {'ctrl': True}
        made.toolbar.active_scroll = wheel
    made.toolbar.autohide = False
    box = made.select_one(BoxSelectTool)
    if box is not None:
        made.toolbar.active_drag = box
    dress(made, style)
    return made


def dress(made: figure, style: Style) -> None:
    """Give a figure the style's colours, and text that can be read."""
    made.background_fill_color = made.border_fill_color = style.background
    made.outline_line_color = style.grid
    if made.title is not None:
        made.title.text_color = style.text
        made.title.text_font_size = '13px'
        made.title.text_font_style = 'normal'
    for axis in made.axis:
        axis.axis_label_text_color = axis.major_label_text_color = style.text
        axis.axis_label_text_font_size = axis.major_label_text_font_size = '12px'
        axis.axis_label_text_font_style = 'normal'
        axis.axis_line_color = axis.major_tick_line_color = style.faint
        axis.minor_tick_line_color = None
    made.grid.grid_line_color = style.grid


def padded(low: float, high: float, share: float = 0.05) -> Range1d:
    """Return a fixed range with some air around it."""
    air = share * (high - low) or max(0.05 * abs(high), 1e-3)
    return Range1d(low - air, high + air)


def short(text: str, most: int = 18) -> str:
    """Return a long name with its middle left out: ends tell joints apart."""
    if len(text) <= most:
        return text
    head = (most - 1) // 2
    return f'{text[:head]}…{text[len(text) - (most - 1 - head):]}'


def dress_legend(made: figure, style: Style) -> None:
    """Make a figure's legend small and readable."""
    made.legend.label_text_color = style.text
    made.legend.label_text_font_size = '12px'
    made.legend.background_fill_color = style.background
    made.legend.background_fill_alpha = 0.8
    made.legend.border_line_color = None
    made.legend.padding = made.legend.margin = 4
    made.legend.spacing = 1
