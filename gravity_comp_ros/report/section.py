"""A part of the page."""

from __future__ import annotations

from dataclasses import dataclass

from bokeh.models import UIElement


@dataclass(frozen=True)
class Section:
    """
    A titled part: `lead` and `after` are safe HTML around the plots, if there are any.

    `key` names it in links and file names.
    """

    key: str
    title: str
    lead: str = ''
    plots: UIElement | None = None
    after: str = ''
