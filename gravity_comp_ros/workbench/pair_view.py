"""View of two models; the selected pair is kept when other models are added."""

from __future__ import annotations

from dataclasses import replace

from bokeh.layouts import column, row
from bokeh.models import UIElement
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.style import Style
from gravity_comp_ros.workbench import compare_view, widgets
from gravity_comp_ros.workbench.choice import Choice
from gravity_comp_ros.workbench.compare_view import ComparedModel
from gravity_comp_ros.workbench.open_session import OpenSession
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.views import element

# Maximum number of cached models; each has the residuals of all samples.
_MAX_CACHED = 4


class PairView:
    """The view and its selected pair of models."""

    def __init__(self) -> None:
        self._chosen: tuple[str, str] | None = None
        self._known: dict[str, tuple[Choice, ComparedModel]] = {}

    def show(self, opened: OpenSession, style: Style) -> UIElement:
        """Return the view of a session's models."""
        models = {key: name for key, name, _ in opened.session.models()}
        if len(models) < 2:
            return widgets.html(markup.paragraph(
                'There is only one model: add an effect, or name further models with --model.'))
        first, second = self._pair(opened, list(models))
        options = list(models.items())
        place = column(sizing_mode='stretch_width')

        def chosen(value: str) -> None:
            self._chosen = (a.value, b.value)
            place.children = [self._compared(opened, a.value, b.value, style)]

        a = widgets.select('A', options, first, chosen, 'model-a')
        b = widgets.select('B', options, second, chosen, 'model-b')
        place.children = [self._compared(opened, first, second, style)]
        return column(row(a, b, sizing_mode='stretch_width'), place, sizing_mode='stretch_width')

    def _pair(self, opened: OpenSession, keys: list[str]) -> tuple[str, str]:
        if self._chosen is not None and set(self._chosen) <= set(keys):
            return self._chosen
        at = opened.session.at or 0
        stage = opened.session.stages[at]
        others = [key for key in keys if key != f'stage {at}']
        before = others[-1] if stage.parent is None else f'stage {stage.parent}'
        return before, f'stage {at}'

    def _compared(self, opened: OpenSession, a: str, b: str, style: Style) -> UIElement:
        try:
            first, second = (self._seen(opened.session, key) for key in (a, b))
            shared = [name for name in first.model.joints if name in second.model.joints]
            plots = compare_view.residuals(
                first, second, opened.session.recording.samples.joints(shared), style)
        except GravityCompError as problem:
            return widgets.html(markup.paragraph(str(problem)))
        return element(compare_view.section(first, second, plots, style))

    def _seen(self, session: Session, key: str) -> ComparedModel:
        name, model = next((name, model) for k, name, model in session.models() if k == key)
        known = self._known.get(key)
        # Use the cached result for the same model and settings.
        if known is not None and known[0] is session.choice and known[1].model is model:
            return replace(known[1], name=name, facts=session.facts(key))
        seen = ComparedModel(name, model, session.facts(key), session.compared(model),
                             session.residual(model))
        self._known = {**self._known, key: (session.choice, seen)} if len(
            self._known) < _MAX_CACHED else {key: (session.choice, seen)}
        return seen
