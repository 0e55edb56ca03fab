"""Views of the current model, built on demand."""

from __future__ import annotations

from bokeh.layouts import column
from bokeh.models import UIElement
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.page import SECTIONS, selector_of
from gravity_comp_ros.report.section import ALL, Section
from gravity_comp_ros.report.table import Table
from gravity_comp_ros.workbench import widgets

# Views with plots of the selected joint.
_BY_JOINT = ('Over time', 'Residual', 'Pairs', 'Spectrum', 'Model')
_NO_ARM = Section('arm', 'The arm', markup.paragraph(
    'No recording contains a /robot_description of these joints. Start the workbench with --urdf '
    'to show the arm.'))


class Views:
    """Views of one model on one set of samples; selections are those of the views before."""

    def __init__(self, contents: Contents, before: Views | None) -> None:
        self.contents, chosen, self._is_chosen = contents, '', False
        self.table = Table(contents)
        if before is not None:
            self.table.select(before.table.selected)
            chosen = before.kept_joint(contents.joints)
            self._is_chosen = bool(chosen)
        self.selector = selector_of(contents, chosen, served=True)
        self.selector.select.on_change('value', lambda attribute, old, new: self._on_joint())
        self._elements: dict[str, UIElement] = {}

    def _on_joint(self) -> None:
        self._is_chosen = True
        self._elements = {name: element for name, element in self._elements.items()
                          if name not in _BY_JOINT}

    def kept_joint(self, joints: tuple[str, ...]) -> str:
        """Return the number of the user's joint among others, or `ALL`; '' to show the worst."""
        value = str(self.selector.select.value)
        if not self._is_chosen or value == ALL:
            return value if self._is_chosen else ''
        name = self.contents.joints[int(value)]
        return str(joints.index(name)) if name in joints else ''

    def show(self, name: str) -> UIElement:
        """Return a view by its name."""
        if name not in self._elements:
            section = SECTIONS[name](self.contents, self.table, self.selector) or _NO_ARM
            above = [self.selector.select] if name in _BY_JOINT else []
            self._elements[name] = column(*above, element(section), sizing_mode='stretch_width')
        return self._elements[name]


def element(section: Section) -> UIElement:
    """Return a section as one element of a page."""
    parts: list[UIElement] = [widgets.html(f'<h2>{markup.text(section.title)}</h2>{section.lead}')]
    if section.plots is not None:
        parts.append(section.plots)
    if section.after:
        parts.append(widgets.html(section.after))
    return column(*parts, sizing_mode='stretch_width')
