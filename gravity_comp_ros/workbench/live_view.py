"""A running node as it works: measured, predicted, residual, coverage, state and events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bokeh.layouts import column
from bokeh.models import ColumnDataSource, DataRange1d, Div, Span, UIElement
from bokeh.plotting import figure
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.style import plot, Style
from gravity_comp_ros.report.tiles import tiles
from gravity_comp_ros.workbench import widgets
if TYPE_CHECKING:
    # Needs ROS, which a page of recordings does without.
    from gravity_comp_ros.node.diagnostics import Status
    from gravity_comp_ros.node.node_client import NodeClient

_SHOWN = 3000
_EVERY = 3
_LEVELS = ('ok', 'warning', 'error', 'stale')
# What is older than this, in s, is not how the node is but how it was. Statuses come once a
# second.
_OLD_TORQUE, _OLD_STATUS = 2.0, 4.0
_MOST_EVENTS = 30


class LiveView:
    """The live view of one page."""

    def __init__(self, follower: NodeClient, style: Style) -> None:
        self.follower, self.style = follower, style
        self._state = widgets.html('', 'live-state')
        self._events = widgets.html('', 'live-events')
        self._plots = column(sizing_mode='stretch_width')
        self.element: UIElement = column(self._state, self._plots, self._events,
                                         sizing_mode='stretch_width')
        self._source: ColumnDataSource | None = None
        self._joints: tuple[str, ...] = ()
        self._seen, self._turn = 0, 0

    def dress(self, style: Style) -> None:
        """Draw in another style from now on."""
        self.style, self._joints, self._seen = style, (), 0

    def update(self, visible: bool) -> None:
        """Show what has come since the last call."""
        self._turn += 1
        if not visible or self._turn % _EVERY:
            return
        joints = self.follower.joints()
        if joints != self._joints:
            self._draw(joints)
        elif self._source is not None:
            self._stream(self._source)
        _put(self._state, self._told())
        _put(self._events, _listed(self.follower.events()))

    def _draw(self, joints: tuple[str, ...]) -> None:
        seen, t, measured, predicted = self.follower.rows(0)
        if not len(t) or measured.shape[1] != len(joints):
            return  # plots of nothing have no axes
        self._joints, self._seen = joints, seen
        source = self._source = ColumnDataSource(_columns(t, measured, predicted))
        time = DataRange1d(follow='end', follow_interval=60.0, range_padding=0.0)
        rows = [[_torque(name, k, source, time, self.style),
                 _residual(k, source, time, self.style)] for k, name in enumerate(self._joints)]
        self._plots.children = [tiles(rows, 300)] if rows else []

    def _stream(self, source: ColumnDataSource) -> None:
        self._seen, t, measured, predicted = self.follower.rows(self._seen)
        if not len(t):
            return
        if measured.shape[1] == len(self._joints):
            source.stream(_columns(t, measured, predicted), rollover=_SHOWN)

    def _told(self) -> str:
        node, statuses = self.follower.node, self.follower.statuses()
        head = f'<h2>Node {markup.text(node)}</h2>'
        if not statuses and not self._joints:
            return head + markup.paragraph(
                'Nothing heard of it yet. Is it running, and in the same ROS_DOMAIN_ID?')
        torque, status = self.follower.ages()
        head += age_html(torque, status)
        table = status_html(statuses, status) if statuses else ''
        if not self._joints:
            return head + table + markup.paragraph('No torque is predicted yet.', 'quiet')
        low, high = self.follower.coverage()
        seen = markup.table(['joint', 'angles seen, rad'],
                            [[name, f'{a:.2f} … {b:.2f}']
                             for name, a, b in zip(self._joints, low, high)])
        key = markup.key([(self.style.measured, 'measured'), (self.style.predicted, 'predicted'),
                          (self.style.residual, 'residual')])
        return head + table + markup.folded('Coverage', seen) + key


def age_html(torque: float | None, status: float | None) -> str:
    """Return how old what is shown is; loud where the node has gone silent."""
    parts, silent = [], False
    for name, age, old in (('torque', torque, _OLD_TORQUE), ('status', status, _OLD_STATUS)):
        if age is None:
            parts.append(f'no {name} yet')
            continue
        silent = silent or age > old
        parts.append(f'last {name} {"less than 1" if age < 1.0 else f"{age:.0f}"} s ago')
    words = ', '.join(parts)
    if silent:
        return f'<p id="live-age" class="level error">SILENT: {words}. What is shown is how ' \
               f'the node was then.</p>'
    return f'<p id="live-age" class="level ok">{words}</p>'


def status_html(statuses: Sequence[Status], age: float | None) -> str:
    """Return the statuses as a table; each level is a word in its colour."""
    stale = age is None or age > _OLD_STATUS
    rows = ''
    for one in statuses:
        was = _LEVELS[min(max(one.level, 0), 3)]
        level = 'stale' if stale else was
        word = f'stale, was {was}' if stale and was != 'stale' else level
        rows += (f'<tr><th scope="row">{markup.text(one.name)}</th>'
                 f'<td><span class="level {level}">{word}</span></td>'
                 f'<td>{markup.text(one.message)}</td></tr>')
    return (f'<div class="wide"><table><thead><tr><th scope="col">part</th><th scope="col">level'
            f'</th><th scope="col">message</th></tr></thead><tbody>{rows}</tbody></table></div>')


def _columns(t: FloatArray, measured: FloatArray, predicted: FloatArray
             ) -> dict[str, FloatArray]:
    columns = {'t': t[-_SHOWN:]}
    for k in range(measured.shape[1]):
        m, p = measured[-_SHOWN:, k], predicted[-_SHOWN:, k]
        columns |= {f'm{k}': m, f'p{k}': p, f'r{k}': m - p}
    return columns


def _torque(name: str, k: int, source: ColumnDataSource, time: DataRange1d,
            style: Style) -> figure:
    made = plot(style, name, 'time, s', 'N·m', 170, 'xpan,xwheel_zoom,reset,save', x_range=time)
    made.line('t', f'm{k}', source=source, color=style.measured)
    made.line('t', f'p{k}', source=source, color=style.predicted, line_dash=[6, 3], line_width=1.5)
    return made


def _residual(k: int, source: ColumnDataSource, time: DataRange1d, style: Style) -> figure:
    made = plot(style, '', 'time, s', 'residual, N·m', 170, 'xpan,xwheel_zoom,reset,save',
                x_range=time)
    made.line('t', f'r{k}', source=source, color=style.residual)
    made.add_layout(Span(location=0.0, dimension='width', line_color=style.faint))
    return made


def _listed(events: Sequence[tuple[str, str]]) -> str:
    shown = [f'{when}  {what}' for when, what in list(events)[-_MOST_EVENTS:][::-1]]
    return '<h3>Events</h3>' + (markup.bullets(shown) or markup.paragraph('None yet.', 'quiet'))


def _put(place: Div, text: str) -> None:
    if place.text != text:
        place.text = text
