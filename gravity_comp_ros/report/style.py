"""Colours and common style of the plots."""

from __future__ import annotations

import re
from typing import Any

from bokeh.models import BoxSelectTool, Range1d, WheelZoomTool
from bokeh.palettes import Cividis256
from bokeh.plotting import figure
from bokeh.themes import Theme
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import css

# Okabe and Ito's hues, distinguishable with any common colour blindness. They have a contrast to
# white that remains when the dark style inverts them.
BLUE, VERMILION, PURPLE = '#0072b2', '#d55e00', '#b0588a'
TEXT, FAINT, GRID = '#1b1f24', '#59636e', '#e3e6ea'
MEASURED, PREDICTED, RESIDUAL, MARKED = TEXT, VERMILION, BLUE, '#c4007a'
UP, DOWN, STILL = BLUE, VERMILION, '#8a8f98'
# From small to large values, the largest with the highest contrast.
HEAT = list(Cividis256[::-1])

TOOLS = 'pan,box_zoom,wheel_zoom,box_select,lasso_select,tap,reset,save'
# Maximum length of a title on a narrow page.
_MAX_TITLE = 42
_LABEL = {'text_color': TEXT, 'text_font_size': '12px', 'text_font_style': 'normal'}
THEME = Theme(json={'attrs': {
    'Plot': {'outline_line_color': GRID},
    'Title': {**_LABEL, 'text_font_size': '13px'},
    'Axis': {**{f'axis_label_{name}': value for name, value in _LABEL.items()},
             'major_label_text_color': TEXT, 'major_label_text_font_size': '12px',
             'axis_line_color': FAINT, 'major_tick_line_color': FAINT,
             'minor_tick_line_color': None},
    'Grid': {'grid_line_color': GRID},
    'ColorBar': {'title_text_color': TEXT, 'major_label_text_color': TEXT},
    'Legend': {'label_text_color': TEXT, 'label_text_font_size': '12px',
               'background_fill_alpha': 0.8, 'border_line_color': None, 'padding': 4,
               'margin': 4, 'spacing': 1}}})


def plot(title: str, x: str, y: str, height: int = 180, tools: str = TOOLS,
         **more: Any) -> figure:
    """
    Return an empty figure in the common style.

    :param x: label of the x axis with its unit; likewise `y`; empty for none.
    """
    fig = figure(height=height, sizing_mode='stretch_width', tools=tools, min_width=120,
                 title=label(title, _MAX_TITLE) or None, x_axis_label=x or None,
                 y_axis_label=y or None, **more)
    fig.toolbar.logo = None
    fig.toolbar.autohide = False
    fig.context_menu = None
    fig.stylesheets = [css.PLOT]
    wheel, box = fig.select_one(WheelZoomTool), fig.select_one(BoxSelectTool)
    if wheel is not None:
        # Over an axis the wheel zooms that axis only; without Ctrl it scrolls the page.
        wheel.modifiers = {'ctrl': True}
        fig.toolbar.active_scroll = wheel
    if box is not None:
        fig.toolbar.active_drag = box
    return fig


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


def label(text: str, max_length: int = 18) -> str:
    """Return text from a file for a title, an axis or a tooltip, without Bokeh's formulas."""
    text = short(printable(text), max_length)
    return re.sub(r'\$(?=\$)', '$ ', text).replace(r'\(', r'\ (').replace(r'\[', r'\ [')
