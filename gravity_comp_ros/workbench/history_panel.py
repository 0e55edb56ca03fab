"""Panel of the stages of the model: errors, undo."""

from __future__ import annotations

from collections.abc import Sequence

from bokeh.models import ColumnDataSource, FixedTicker, Legend, UIElement
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.style import (
    BLUE, GREEN, label, ORANGE, plot, PURPLE, SKY, VERMILION, YELLOW)
from gravity_comp_ros.workbench import widgets
from gravity_comp_ros.workbench.results import Results

_COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, YELLOW)
_DASHES = ('solid', 'dashed')
_MARKERS = ('circle', 'square', 'triangle', 'diamond', 'inverted_triangle', 'hex',
            'star')
_HEIGHT, _LEGEND_ROW = 180, 19
# Maximum number of stages in the chart; each compares its model on all samples.
_MAX_STAGES = 8
# Name of a stage, and its errors by joint in N·m.
Errors = Sequence[tuple[str, dict[str, float]]]


def parts(results: Results) -> list[UIElement]:
    """Return the panel of a session."""
    session, stage, at = results.session, results.session.stage, results.session.at
    errors = [] if at is None or not session.is_read else [
        (stage.name, known) for stage in session.stages[:at + 1][-_MAX_STAGES:]
        if (known := results.errors(stage))]
    elements: list[UIElement] = [widgets.html('<h2>Error history</h2>' + last_change(errors))]
    if len(errors) > 1:
        elements.append(chart(errors))
    if stage is None or at is None:
        return elements
    options = [(str(k), f'{k + 1}. {s.name}' + (' (undone)' if k > at else ''))
               for k, s in enumerate(session.stages)]
    if at > 0:
        elements.append(widgets.button(
            f'Undo {stage.name}', lambda: session.select_stage(at - 1), name='undo'))
    return [*elements, widgets.select('Stage', options, str(at),
                                      lambda value: session.select_stage(int(value)), 'stage')]


def chart(stages: Errors) -> UIElement:
    """Return the RMSE by joint over the stages."""
    joints = list(stages[-1][1])
    fig = plot('error by stage, on the selected samples', '', 'RMSE, N·m',
               max(_HEIGHT, 50 + _LEGEND_ROW * len(joints)), 'hover',
               x_range=(-0.5, len(stages) - 0.5))
    entries = []
    for n, joint in enumerate(joints):
        source = ColumnDataSource({
            'x': list(range(len(stages))),
            'y': [errors.get(joint, float('nan')) for _, errors in stages],
            'joint': [label(joint, 60)] * len(stages)})
        line = fig.line('x', 'y', source=source, color=_COLOURS[n % len(_COLOURS)], line_width=2,
                        line_dash=_DASHES[n // len(_COLOURS) % 2])
        dot = fig.scatter('x', 'y', source=source, color=_COLOURS[n % len(_COLOURS)], size=8,
                          marker=_MARKERS[n % len(_MARKERS)])
        entries.append((label(joint, 15), [line, dot]))
    fig.y_range.start = 0.0
    fig.xaxis.ticker = FixedTicker(ticks=list(range(len(stages))))
    fig.xaxis.major_label_overrides = {k: label(name, 12) for k, (name, _) in enumerate(stages)}
    fig.xaxis.major_label_orientation = 0.5 if len(stages) > 2 else 'horizontal'
    fig.hover.tooltips = [('joint', '@joint'), ('RMSE', '@y{0.0000} N·m')]
    fig.add_layout(Legend(items=entries), 'right')
    fig.toolbar_location = None
    return fig


def last_change(stages: Errors) -> str:
    """Return the last change of the error as HTML."""
    if len(stages) < 2:
        return markup.paragraph('The errors of all stages appear here.', 'quiet')
    (_, before), (name, now) = stages[-2:]
    shared = [joint for joint in now if before.get(joint, 0.0) > 0.0]
    if not shared:
        return ''
    joint = min(shared, key=lambda joint: now[joint] / before[joint])
    return (f'<p>{markup.text(name)}: RMSE of {markup.text(joint)} '
            f'<b class="fall">{before[joint]:.4f} → {now[joint]:.4f} N·m</b> '
            f'({100.0 * (now[joint] / before[joint] - 1.0):+.0f} %)</p>')
