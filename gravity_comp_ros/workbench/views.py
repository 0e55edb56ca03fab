"""Views of the current model, built on demand, and of two models on the same samples."""

from __future__ import annotations

from dataclasses import replace

from bokeh.layouts import column, gridplot, row
from bokeh.models import Select, UIElement
from bokeh.plotting import figure
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents, Table
from gravity_comp_ros.report.page import BY_JOINT, SECTIONS
from gravity_comp_ros.report.section import ALL, by_joint, joint_selector, Section
from gravity_comp_ros.report.style import bar_key, bar_plot
from gravity_comp_ros.report.views import residuals, summary
from gravity_comp_ros.workbench import widgets
from gravity_comp_ros.workbench.results import Results
from gravity_comp_ros.workbench.store import Stage

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


class TwoModels:
    """The view of one page; the selected pair is kept when other models are added."""

    def __init__(self) -> None:
        self._chosen: tuple[str, str] | None = None

    def show(self, results: Results) -> UIElement:
        """Return the view of a session's models."""
        models = {stage.name: stage for stage in results.models()}
        if len(models) < 2:
            return widgets.html(markup.paragraph(
                'There is only one model: add an effect, or name further models with --model.'))
        at = results.session.at or 0
        names = list(models)
        first, second = self._chosen if self._chosen and set(self._chosen) <= set(names) else (
            names[at - 1], names[at])
        place = column(sizing_mode='stretch_width')

        def choose(value: str) -> None:
            self._chosen = (str(a.value), str(b.value))
            place.children = [_compared(results, models[a.value], models[b.value])]

        options = [(name, name) for name in names]
        a = widgets.select('A', options, first, choose, 'model-a')
        b = widgets.select('B', options, second, choose, 'model-b')
        place.children = [_compared(results, models[first], models[second])]
        return column(row(a, b, sizing_mode='stretch_width'), place, sizing_mode='stretch_width')


def _compared(results: Results, a: Stage, b: Stage) -> UIElement:
    try:
        contents = [results.contents_of(stage) for stage in (a, b)]
        joints = tuple(name for name in b.model.joints if name in a.model.joints)
        if not joints:
            raise GravityCompError('these models have no common joint')
    except GravityCompError as problem:
        return widgets.html(markup.paragraph(str(problem)))
    both = replace(contents[1], displayed=joints, previous=results.errors(a),
                   previous_name=a.name)
    errors, bars = summary.errors(both), summary.error_bars(both)
    # A grid, because Bokeh lays out a plot next to a grid incorrectly.
    parts = [gridplot([[bar_plot('RMSE, N·m', joints, bars, '0.0000')]],
                      sizing_mode='stretch_width', toolbar_location=None),
             _residuals(contents, joints)]
    lead = markup.paragraph(f'A is {a.name}, B is {b.name}.', 'quiet')
    return element(Section(
        'compare', f'{b.name} against {a.name}',
        lead + _contents_table(results, a, b) + errors.lead + bar_key(bars),
        column(*parts, sizing_mode='stretch_width'), errors.after))


def _contents_table(results: Results, a: Stage, b: Stage) -> str:
    """Return a table of the provenance and the effects of both models."""
    of_a, of_b = results.facts(a), results.facts(b)
    rows = [[what, of_a[what], of_b[what]] for what in of_a]
    in_a, in_b = ({effect.target: markup.units(wording.coefficients(effect.coefficients, 6))
                   for effect in stage.model.applied.effects} for stage in (a, b))
    rows += [[target, in_a.get(target, 'not included'), in_b.get(target, 'not included')]
             for target in dict.fromkeys([*in_a, *in_b])]
    return markup.table(['', 'A', 'B'], rows, left=('A', 'B'))


def _residuals(contents: list[Contents], joints: tuple[str, ...]) -> UIElement:
    """Return a selector of the joint, and plots of its residual, A left and B right."""
    tables, selector = [Table(each) for each in contents], joint_selector(joints, '0')

    def plots(n: int) -> list[figure]:
        figures = [residuals.over_time(each, table, each.model.joints.index(joints[n]))
                   for each, table in zip(contents, tables)]
        for letter, fig in zip('AB', figures):
            fig.title.text = f'{letter} {fig.title.text}'
            fig.x_range, fig.y_range = figures[0].x_range, figures[0].y_range
        return figures

    return column(selector, by_joint(selector, plots, 300), sizing_mode='stretch_width')
