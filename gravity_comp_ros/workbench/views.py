"""Views of the current model, built on demand and cached until the model changes."""

from __future__ import annotations

from bokeh.layouts import column
from bokeh.models import UIElement
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.sections import SECTIONS
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import Style
from gravity_comp_ros.workbench import widgets

_NO_ARM = Section('arm', 'The arm', markup.paragraph(
    'No recording contains a /robot_description of these joints. Start the workbench with --urdf '
    'to show the arm.'))


class Views:
    """Views of one model on one set of samples, in one style."""

    def __init__(self, contents: Contents, style: Style, selected: list[int]) -> None:
        self.contents, self.style = contents, style
        self.table = Table(contents)
        self.table.select(selected)
        self._elements: dict[str, UIElement] = {}

    def show(self, name: str) -> UIElement:
        """Return a view by its name."""
        if name not in self._elements:
            section = SECTIONS[name](self.contents, self.table, self.style)
            self._elements[name] = element(section or _NO_ARM)
        return self._elements[name]


def element(section: Section) -> UIElement:
    """Return a section as one element of a page."""
    parts: list[UIElement] = [widgets.html(f'<h2>{markup.text(section.title)}</h2>{section.lead}')]
    if section.plots is not None:
        parts.append(section.plots)
    if section.after:
        parts.append(widgets.html(section.after))
    return column(*parts, sizing_mode='stretch_width')
