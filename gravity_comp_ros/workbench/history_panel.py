"""Panel of the stages of the model: errors along the branch, names, notes, and undo."""

from __future__ import annotations

from collections.abc import Sequence

from bokeh.layouts import column, row
from bokeh.models import ColumnDataSource, FixedTicker, Legend, UIElement
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.style import (
    BLUE, canvas_text, dress_legend, GREEN, ORANGE, plot, PURPLE, short, SKY, Style, VERMILION,
    YELLOW)
from gravity_comp_ros.workbench import widgets
from gravity_comp_ros.workbench.open_session import OpenSession
from gravity_comp_ros.workbench.stages import depth, path_to, Stage

_COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, YELLOW)
_DASHES = ('solid', 'dashed')
_MARKERS = ('circle', 'square', 'triangle', 'diamond', 'inverted_triangle', 'hex',
            'star')
_MAX_LABEL = 16
_HEIGHT, _LEGEND_ROW = 180, 19


class HistoryPanel:
    """The panel of one page. It keeps the text fields, and unfinished input, over updates."""

    def __init__(self) -> None:
        self._shown: tuple[str, int, str, str] | None = None
        self._text_fields: UIElement = row()

    def parts(self, opened: OpenSession, style: Style) -> list[UIElement]:
        """Return the panel of a session."""
        session = opened.session
        stages, at = session.stages, session.at
        branch = [] if at is None else [stages[k] for k in path_to(stages, at)]
        elements: list[UIElement] = [widgets.html('<h2>Error history</h2>' + last_change(branch))]
        drawn = chart(branch, style)
        if drawn is not None:
            elements.append(drawn)
        stage = session.stage
        if stage is None or at is None:
            return elements
        options = [(str(k), f'{"· " * depth(stages, k)}{k + 1}. {s.name}'
                    + (f' – {s.note}' if s.note else '')) for k, s in enumerate(stages)]
        elements.append(widgets.select(
            'Stage (select another one to go back or branch)', options, str(at),
            lambda value: opened.select_stage(int(value)), 'stage'))
        if stage.effects or any(step.previous for step in stage.model.history):
            elements.append(widgets.button('Undo the last addition', opened.undo, name='undo'))
        key = (opened.id, at, stage.name, stage.note)
        if self._shown != key:
            self._shown, self._text_fields = key, self._fields(opened, at, stage)
        return [*elements, self._text_fields]

    def _fields(self, opened: OpenSession, at: int, stage: Stage) -> UIElement:
        """Return the text fields for the name and the note of a stage."""
        name = widgets.field('Name of this stage', stage.name, 'stage-name')
        note = widgets.field('Note', stage.note, 'stage-note')

        def on_change(attribute: str, old: str, new: str) -> None:
            self._shown = (opened.id, at, name.value, note.value)
            opened.describe(name.value, note.value)

        for entry in (name, note):
            entry.on_change('value', on_change)
        return row(column(name, sizing_mode='stretch_width'),
                   column(note, sizing_mode='stretch_width'), sizing_mode='stretch_width')


def chart(stages: Sequence[Stage], style: Style) -> UIElement | None:
    """Return the held-out RMSE by joint over the stages; None for less than two stages."""
    known = [(k, stage) for k, stage in enumerate(stages) if stage.held_out]
    if len(known) < 2:
        return None
    joints = stages[-1].model.joints
    fig = plot(style, 'held-out error by stage', '', 'RMSE, N·m',
               max(_HEIGHT, 50 + _LEGEND_ROW * len(joints)), 'hover',
               x_range=(-0.3, max(len(stages) - 0.7, 0.7)))
    entries = []
    for n, joint in enumerate(joints):
        colour = _COLOURS[n % len(_COLOURS)]
        dash = _DASHES[n // len(_COLOURS) % 2]
        source = ColumnDataSource({
            'x': [k for k, _ in known], 'y': [s.held_out.get(joint, float('nan'))
                                              for _, s in known],
            'joint': [canvas_text(printable(joint))] * len(known)})
        line = fig.line('x', 'y', source=source, color=colour, line_width=2, line_dash=dash)
        dot = fig.scatter('x', 'y', source=source, color=colour, size=8,
                          marker=_MARKERS[n % len(_MARKERS)])
        entries.append((canvas_text(short(printable(joint), 15)), [line, dot]))
    fig.y_range.start = 0.0
    fig.xaxis.ticker = FixedTicker(ticks=list(range(len(stages))))
    fig.xaxis.major_label_overrides = {k: canvas_text(_short(s.name))
                                       for k, s in enumerate(stages)}
    fig.xaxis.major_label_orientation = 0.5 if len(stages) > 2 else 'horizontal'
    fig.hover.tooltips = [('joint', '@joint'), ('held-out RMSE', '@y{0.0000} N·m')]
    fig.add_layout(Legend(items=entries), 'right')
    dress_legend(fig, style)
    fig.toolbar_location = None
    return fig


def last_change(stages: Sequence[Stage]) -> str:
    """Return the last change of the held-out error as HTML."""
    known = [stage for stage in stages if stage.held_out]
    if not known:
        return markup.paragraph('No held-out errors yet.', 'quiet')
    last = known[-1].held_out
    if len(known) < 2:
        worst = max(last, key=lambda name: last[name])
        return markup.paragraph(f'Held-out RMSE is largest on {worst}: {last[worst]:.4f} N·m.')
    before = known[-2].held_out
    shared = [name for name in last if name in before and before[name] > 0.0]
    joint = min(shared, key=lambda name: last[name] / before[name])
    change = 100.0 * (last[joint] / before[joint] - 1.0)
    return (f'<p>{markup.text(known[-1].name)}: held-out RMSE of {markup.text(joint)} '
            f'<b class="fall">{before[joint]:.4f} → {last[joint]:.4f} N·m</b> ({change:+.0f} %)'
            f'</p>')


def _short(name: str) -> str:
    return name if len(name) <= _MAX_LABEL else f'{name[:_MAX_LABEL - 1]}…'
