"""The error at every stage of the model: how it falls as effects are added."""

from __future__ import annotations

from collections.abc import Sequence

from bokeh.models import ColumnDataSource, FixedTicker, Legend, UIElement
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.style import (
    BLUE, canvas_text, dress_legend, GREEN, ORANGE, plot, PURPLE, short, SKY, Style, VERMILION,
    YELLOW)
from gravity_comp_ros.workbench.stages import Stage

_COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, YELLOW)
_DASHES = ('solid', 'dashed')
_MARKERS = ('circle', 'square', 'triangle', 'diamond', 'inverted_triangle', 'hex',
            'star')
_LONGEST = 16
_HEIGHT, _LEGEND_ROW = 180, 19


def chart(stages: Sequence[Stage], style: Style) -> UIElement | None:
    """Return held-out RMSE by joint over the stages; None where there are no two to compare."""
    known = [(k, stage) for k, stage in enumerate(stages) if stage.held_out]
    if len(known) < 2:
        return None
    joints = stages[-1].model.joints
    made = plot(style, 'held-out error at every stage', '', 'RMSE, N·m',
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
        line = made.line('x', 'y', source=source, color=colour, line_width=2, line_dash=dash)
        dot = made.scatter('x', 'y', source=source, color=colour, size=8,
                           marker=_MARKERS[n % len(_MARKERS)])
        entries.append((canvas_text(short(printable(joint), 15)), [line, dot]))
    made.y_range.start = 0.0
    made.xaxis.ticker = FixedTicker(ticks=list(range(len(stages))))
    made.xaxis.major_label_overrides = {k: canvas_text(_short(s.name))
                                        for k, s in enumerate(stages)}
    made.xaxis.major_label_orientation = 0.5 if len(stages) > 2 else 'horizontal'
    made.hover.tooltips = [('joint', '@joint'), ('held-out RMSE', '@y{0.0000} N·m')]
    made.add_layout(Legend(items=entries), 'right')
    dress_legend(made, style)
    made.toolbar_location = None
    return made


def numbers(stages: Sequence[Stage]) -> str:
    """Return the last change in numbers, as HTML."""
    known = [stage for stage in stages if stage.held_out]
    if not known:
        return markup.paragraph('Errors of held-out data appear here once there are some.',
                                'quiet')
    last = known[-1].held_out
    if len(known) < 2:
        worst = max(last, key=lambda name: last[name])
        return markup.paragraph(f'Held-out RMSE is largest on {worst}: {last[worst]:.4f} N·m.')
    before = known[-2].held_out
    shared = [name for name in last if name in before and before[name] > 0.0]
    most = min(shared, key=lambda name: last[name] / before[name])
    change = 100.0 * (last[most] / before[most] - 1.0)
    return (f'<p>{markup.text(known[-1].name)}: held-out RMSE of {markup.text(most)} '
            f'<b class="fall">{before[most]:.4f} → {last[most]:.4f} N·m</b> ({change:+.0f} %)</p>')


def _short(name: str) -> str:
    return name if len(name) <= _LONGEST else f'{name[:_LONGEST - 1]}…'
