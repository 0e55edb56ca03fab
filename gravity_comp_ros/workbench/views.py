"""Views of the current model, built on demand."""

from __future__ import annotations

from bokeh.layouts import column
from bokeh.models import Select, UIElement
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents, Table
from gravity_comp_ros.report.page import BY_JOINT, SECTIONS
from gravity_comp_ros.report.section import ALL, joint_selector, Section
from gravity_comp_ros.workbench import widgets

_NO_ARM = Section('arm', 'The arm', markup.paragraph(
    'No recording contains a /robot_description of these joints. Start the workbench with --urdf '
    'to show the arm.'))


class Views:
    """Views of one model on one set of samples; selections are those of the views before."""

    def __init__(self, contents: Contents, before: Views | None) -> None:
        self.contents, self.table = contents, Table(contents)
        self._worst = self._joint = str(contents.joints.index(contents.worst))
        if before is not None:
            self.table.select(before.table.selected)
            self._joint = before.kept_joint(contents.joints) or self._worst
        self._elements: dict[str, tuple[Select, UIElement]] = {}

    def kept_joint(self, joints: tuple[str, ...]) -> str:
        """Return the number of the user's joint among others, or `ALL`; '' to show the worst."""
        if self._joint in (ALL, self._worst):
            return self._joint if self._joint == ALL else ''
        name = self.contents.joints[int(self._joint)]
        return str(joints.index(name)) if name in joints else ''

    def show(self, name: str) -> UIElement:
        """Return a view by its name; each has a selector of its own, which holds its plots."""
        selector, view = self._elements.get(name, (None, None))
        if selector is None or view is None or (
                name in BY_JOINT and selector.value != self._joint):
            selector = joint_selector(self.contents.joints, self._joint)
            selector.on_change('value', self._on_joint)
            section = SECTIONS[name](self.contents, self.table, selector) or _NO_ARM
            above = [selector] if name in BY_JOINT else []
            view = column(*above, element(section), sizing_mode='stretch_width')
            self._elements[name] = selector, view
        return view

    def _on_joint(self, attribute: str, old: str, new: str) -> None:
        self._joint = new


def element(section: Section) -> UIElement:
    """Return a section as one element of a page."""
    parts: list[UIElement] = [widgets.html(f'<h2>{markup.text(section.title)}</h2>{section.lead}')]
    if section.plots is not None:
        parts.append(section.plots)
    if section.after:
        parts.append(widgets.html(section.after))
    return column(*parts, sizing_mode='stretch_width')
