"""A section of the report."""

from __future__ import annotations

from dataclasses import dataclass

from bokeh.models import UIElement


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
