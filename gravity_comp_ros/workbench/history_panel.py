"""The stages of the model: the error along the branch, names, notes, and the way back."""

from __future__ import annotations

from bokeh.layouts import column, row
from bokeh.models import UIElement
from gravity_comp_ros.report.style import Style
from gravity_comp_ros.workbench import history_view, widgets
from gravity_comp_ros.workbench.open_session import OpenSession
from gravity_comp_ros.workbench.stages import depth, path_to, Stage


class HistoryPanel:
    """The panel of one page. What is being typed outlives the end of a job."""

    def __init__(self) -> None:
        self._of: tuple[str, int, str, str] | None = None
        self._words: UIElement = row()

    def parts(self, one: OpenSession, style: Style) -> list[UIElement]:
        """Return the panel of a session."""
        session = one.session
        stages, at = session.stages, session.at
        branch = [] if at is None else [stages[k] for k in path_to(stages, at)]
        shown: list[UIElement] = [widgets.html('<h2>Error so far</h2>'
                                               + history_view.numbers(branch))]
        chart = history_view.chart(branch, style)
        if chart is not None:
            shown.append(chart)
        stage = session.stage
        if stage is None or at is None:
            return shown
        options = [(str(k), f'{"· " * depth(stages, k)}{k + 1}. {s.name}'
                    + (f' – {s.note}' if s.note else '')) for k, s in enumerate(stages)]
        shown.append(widgets.select('Stage (another one is a way back, and a branch)',
                                    options, str(at), lambda value: one.go_to(int(value)),
                                    'stage'))
        if stage.effects or any(step.previous for step in stage.model.history):
            shown.append(widgets.button('Undo the last addition', one.undo, name='undo'))
        of = (one.id, at, stage.name, stage.note)
        if self._of != of:
            self._of, self._words = of, self._fields(one, at, stage)
        return [*shown, self._words]

    def _fields(self, one: OpenSession, at: int, stage: Stage) -> UIElement:
        """Return the fields for the name of a stage and for a note."""
        name = widgets.field('Name of this stage', stage.name, 'stage-name')
        note = widgets.field('Note', stage.note, 'stage-note')

        def written(attribute: str, old: str, new: str) -> None:
            self._of = (one.id, at, name.value, note.value)
            one.describe(name.value, note.value)

        for entry in (name, note):
            entry.on_change('value', written)
        return row(column(name, sizing_mode='stretch_width'),
                   column(note, sizing_mode='stretch_width'), sizing_mode='stretch_width')
