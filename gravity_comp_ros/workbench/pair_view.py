"""Two models side by side: the two that were chosen stay, whatever is added meanwhile."""

from __future__ import annotations

from bokeh.layouts import column, row
from bokeh.models import UIElement
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.style import Style
from gravity_comp_ros.workbench import compare_view, widgets
from gravity_comp_ros.workbench.open_session import OpenSession
from gravity_comp_ros.workbench.views import element

_Named = tuple[str, GravityModel]


class PairView:
    """The view, and which two models it compares."""

    def __init__(self) -> None:
        self._chosen: tuple[str, str] | None = None

    def show(self, one: OpenSession, style: Style) -> UIElement:
        """Return the view of a session's models."""
        models = {key: (name, model) for key, name, model in one.session.models()}
        if len(models) < 2:
            return widgets.html(markup.paragraph(
                'There is no other model yet: add an effect, or name models with --model.'))
        first, second = self._pair(one, list(models))
        options = [(key, name) for key, (name, _) in models.items()]
        place = column(sizing_mode='stretch_width')

        def chosen(value: str) -> None:
            self._chosen = (a.value, b.value)
            place.children = [self._compared(one, models[a.value], models[b.value], style)]

        a = widgets.select('A', options, first, chosen, 'model-a')
        b = widgets.select('B', options, second, chosen, 'model-b')
        place.children = [self._compared(one, models[first], models[second], style)]
        return column(row(a, b, sizing_mode='stretch_width'), place, sizing_mode='stretch_width')

    def _pair(self, one: OpenSession, keys: list[str]) -> tuple[str, str]:
        if self._chosen is not None and set(self._chosen) <= set(keys):
            return self._chosen
        at = one.session.at or 0
        stage = one.session.stages[at]
        others = [key for key in keys if key != f'stage {at}']
        before = others[-1] if stage.parent is None else f'stage {stage.parent}'
        return before, f'stage {at}'

    def _compared(self, one: OpenSession, a: _Named, b: _Named, style: Style) -> UIElement:
        try:
            found = [one.session.compared(model) for _, model in (a, b)]
        except GravityCompError as problem:
            return widgets.html(markup.paragraph(str(problem)))
        return element(compare_view.section(b[0], found[1], a[0], found[0], style))
