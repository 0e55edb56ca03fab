"""Live view of a running node: torques, residual, coverage, status and events."""

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
    # Requires ROS, which a page of recordings does not use.
    from gravity_comp_ros.node.diagnostics import Status
    from gravity_comp_ros.node.node_client import NodeClient

_MAX_ROWS = 3000
# Number of polls of the page per update.
_UPDATE_INTERVAL = 3
_LEVELS = ('ok', 'warning', 'error', 'stale')
# Maximum age, in s, of current torques and statuses. Statuses are published once a second.
_MAX_TORQUE_AGE, _MAX_STATUS_AGE = 2.0, 4.0
_MAX_EVENTS = 30


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
        self._seen, self._polls = 0, 0

    def restyle(self, style: Style) -> None:
        """Change the style of the plots."""
        self.style, self._joints, self._seen = style, (), 0

    def update(self, visible: bool) -> None:
        """Show the data received since the last call."""
        self._polls += 1
        if not visible or self._polls % _UPDATE_INTERVAL:
            return
        joints = self.follower.joints()
        if joints != self._joints:
            self._draw(joints)
        elif self._source is not None:
            self._stream(self._source)
        _set_text(self._state, self._state_html())
        _set_text(self._events, _event_list(self.follower.events()))

    def _draw(self, joints: tuple[str, ...]) -> None:
        seen, t, measured, predicted = self.follower.rows(0)
        if not len(t) or measured.shape[1] != len(joints):
            return  # plots without data have no axes
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
            source.stream(_columns(t, measured, predicted), rollover=_MAX_ROWS)

    def _state_html(self) -> str:
        node, statuses = self.follower.node, self.follower.statuses()
        head = f'<h2>Node {markup.text(node)}</h2>'
        if not statuses and not self._joints:
            return head + markup.paragraph(
                'No message received yet. Is the node running, in the same ROS_DOMAIN_ID?')
        torque, status = self.follower.ages()
        head += age_html(torque, status)
        table = status_html(statuses, status) if statuses else ''
        if not self._joints:
            return head + table + markup.paragraph('No torque is predicted yet.', 'quiet')
        low, high = self.follower.coverage()
        ranges = markup.table(['joint', 'visited range, rad'],
                              [[name, f'{a:.2f} … {b:.2f}']
                               for name, a, b in zip(self._joints, low, high)])
        key = markup.key([(self.style.measured, 'measured'), (self.style.predicted, 'predicted'),
                          (self.style.residual, 'residual')])
        return head + table + markup.folded('Coverage', ranges) + key


def age_html(torque: float | None, status: float | None) -> str:
    """Return the age of the shown data, as an error if the node is silent."""
    parts, silent = [], False
    for name, age, limit in (('torque', torque, _MAX_TORQUE_AGE),
                             ('status', status, _MAX_STATUS_AGE)):
        if age is None:
            parts.append(f'no {name} yet')
            continue
        silent = silent or age > limit
        parts.append(f'last {name} {"less than 1" if age < 1.0 else f"{age:.0f}"} s ago')
    text = ', '.join(parts)
    if silent:
        return f'<p id="live-age" class="level error">SILENT: {text}. The data below is from ' \
               f'that time.</p>'
    return f'<p id="live-age" class="level ok">{text}</p>'


def status_html(statuses: Sequence[Status], age: float | None) -> str:
    """Return the statuses as a table, with coloured levels."""
    stale = age is None or age > _MAX_STATUS_AGE
    rows = ''
    for status in statuses:
        published = _LEVELS[min(max(status.level, 0), 3)]
        level = 'stale' if stale else published
        text = f'stale, was {published}' if stale and published != 'stale' else level
        rows += (f'<tr><th scope="row">{markup.text(status.name)}</th>'
                 f'<td><span class="level {level}">{text}</span></td>'
                 f'<td>{markup.text(status.message)}</td></tr>')
    return (f'<div class="wide"><table><thead><tr><th scope="col">part</th><th scope="col">level'
            f'</th><th scope="col">message</th></tr></thead><tbody>{rows}</tbody></table></div>')


def _columns(t: FloatArray, measured: FloatArray, predicted: FloatArray
             ) -> dict[str, FloatArray]:
    columns = {'t': t[-_MAX_ROWS:]}
    for k in range(measured.shape[1]):
        m, p = measured[-_MAX_ROWS:, k], predicted[-_MAX_ROWS:, k]
        columns |= {f'm{k}': m, f'p{k}': p, f'r{k}': m - p}
    return columns


def _torque(name: str, k: int, source: ColumnDataSource, time: DataRange1d,
            style: Style) -> figure:
    fig = plot(style, name, 'time, s', 'N·m', 170, 'xpan,xwheel_zoom,reset,save', x_range=time)
    fig.line('t', f'm{k}', source=source, color=style.measured)
    fig.line('t', f'p{k}', source=source, color=style.predicted, line_dash=[6, 3], line_width=1.5)
    return fig


def _residual(k: int, source: ColumnDataSource, time: DataRange1d, style: Style) -> figure:
    fig = plot(style, '', 'time, s', 'residual, N·m', 170, 'xpan,xwheel_zoom,reset,save',
               x_range=time)
    fig.line('t', f'r{k}', source=source, color=style.residual)
    fig.add_layout(Span(location=0.0, dimension='width', line_color=style.faint))
    return fig


def _event_list(events: Sequence[tuple[str, str]]) -> str:
    lines = [f'{time}  {text}' for time, text in list(events)[-_MAX_EVENTS:][::-1]]
    return '<h3>Events</h3>' + (markup.bullets(lines) or markup.paragraph('None yet.', 'quiet'))


def _set_text(element: Div, text: str) -> None:
    if element.text != text:
        element.text = text
