"""Bokeh's widgets in the looks of the page; text from files never becomes markup."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from bokeh.models import (
    Button, CheckboxGroup, Div, RadioButtonGroup, Select, TextInput, UIElement)
from gravity_comp_ros.printable import printable
from gravity_comp_ros.workbench.page_style import INSIDE


def html(text: str, name: str | None = None, **more: Any) -> Div:
    """Return safe HTML as an element."""
    return Div(text=text, name=name, stylesheets=[INSIDE], sizing_mode='stretch_width',
               disable_math=True, **more)


def button(label: str, action: Callable[[], None], kind: str = 'default',
           **more: Any) -> Button:
    """Return a button."""
    made = Button(label=printable(label), button_type=kind, stylesheets=[INSIDE], **more)
    made.on_click(lambda event: action())
    return made


def select(title: str, options: Sequence[tuple[str, str]], value: str,
           action: Callable[[str], None] | None = None, name: str = '') -> Select:
    """Return a choice of one among (value, text)."""
    made = Select(title=title, value=value, stylesheets=[INSIDE], sizing_mode='stretch_width',
                  options=[(key, printable(text)) for key, text in options], name=name or None)
    if action is not None:
        made.on_change('value', lambda attribute, old, new: action(new))
    return made


def boxes(labels: Sequence[str], active: Sequence[int], name: str = '') -> CheckboxGroup:
    """Return boxes to tick."""
    return CheckboxGroup(labels=[printable(label) for label in labels], active=list(active),
                         stylesheets=[INSIDE], name=name or None)


def field(title: str, value: str, name: str, placeholder: str = '') -> TextInput:
    """Return a line to write in."""
    return TextInput(title=printable(title), value=value, placeholder=placeholder, name=name,
                     stylesheets=[INSIDE], sizing_mode='stretch_width')


def tabs(labels: Sequence[str], action: Callable[[int], None]) -> RadioButtonGroup:
    """Return a row of buttons of which one is pressed."""
    made = RadioButtonGroup(labels=list(labels), active=0, stylesheets=[INSIDE])
    made.on_change('active', lambda attribute, old, new: action(new))
    return made


def turn(element: UIElement) -> None:
    """Show what is hidden, or hide it."""
    element.visible = not element.visible
