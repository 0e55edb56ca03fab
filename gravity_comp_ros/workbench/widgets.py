"""Widgets of Bokeh in the style of the page, with escaped text."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from bokeh.models import (
    Button, CheckboxGroup, Div, RadioButtonGroup, Select, TextInput, UIElement)
from gravity_comp_ros.printable import printable
from gravity_comp_ros.workbench.page_style import INSIDE


def html(text: str, name: str | None = None, **more: Any) -> Div:
    """Return an element with safe HTML."""
    return Div(text=text, name=name, stylesheets=[INSIDE], sizing_mode='stretch_width',
               disable_math=True, **more)


def button(label: str, action: Callable[[], None], kind: str = 'default',
           **more: Any) -> Button:
    """Return a button."""
    widget = Button(label=printable(label), button_type=kind, stylesheets=[INSIDE], **more)
    widget.on_click(lambda event: action())
    return widget


def select(title: str, options: Sequence[tuple[str, str]], value: str,
           action: Callable[[str], None] | None = None, name: str = '') -> Select:
    """Return a drop-down list of (value, text) options."""
    widget = Select(title=title, value=value, stylesheets=[INSIDE], sizing_mode='stretch_width',
                    options=[(key, printable(text)) for key, text in options], name=name or None)
    if action is not None:
        widget.on_change('value', lambda attribute, old, new: action(new))
    return widget


def boxes(labels: Sequence[str], active: Sequence[int], name: str = '') -> CheckboxGroup:
    """Return check boxes."""
    return CheckboxGroup(labels=[printable(label) for label in labels], active=list(active),
                         stylesheets=[INSIDE], name=name or None)


def field(title: str, value: str, name: str, placeholder: str = '') -> TextInput:
    """Return a text field."""
    return TextInput(title=printable(title), value=value, placeholder=placeholder, name=name,
                     stylesheets=[INSIDE], sizing_mode='stretch_width')


def tabs(labels: Sequence[str], action: Callable[[int], None]) -> RadioButtonGroup:
    """Return a row of tabs."""
    widget = RadioButtonGroup(labels=list(labels), active=0, stylesheets=[INSIDE])
    widget.on_change('active', lambda attribute, old, new: action(new))
    return widget


def toggle(element: UIElement) -> None:
    """Toggle the visibility of an element."""
    element.visible = not element.visible
