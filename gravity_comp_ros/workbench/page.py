"""The workbench page: settings in the side bar, findings and error history above the views."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import logging
import secrets

from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.layouts import column, row
from bokeh.models import CustomJS, Select, UIElement
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.facts.fact import Action
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents, Table
from gravity_comp_ros.report.page import BY_JOINT, SECTIONS
from gravity_comp_ros.report.section import ALL, joint_selector, Section
from gravity_comp_ros.report.style import THEME
from gravity_comp_ros.report.views.summary import headline
from gravity_comp_ros.workbench import panels, widgets
from gravity_comp_ros.workbench.access import ARGUMENT
from gravity_comp_ros.workbench.jobs import ReadResult
from gravity_comp_ros.workbench.panels import Sidebar
from gravity_comp_ros.workbench.results import Results
from gravity_comp_ros.workbench.session import Session, Sessions
from gravity_comp_ros.workbench.store import Entry, Stage

_LOG = logging.getLogger(__name__)
_POLL_MS = 100
_TOGGLE_DARK = "document.documentElement.classList.toggle('dark')"
_READY = "document.documentElement.dataset.ready = 'yes'"
NAMES = tuple(SECTIONS)


class Page:
    """
    The page of one browser window. It attaches a session after the browser has drawn the page.

    :param token: token of the server, for links to other sessions.
    :param identity: session id in the URL; an unknown id gives a new session.
    """

    def __init__(self, document: Document, sessions: Sessions, token: str,
                 identity: str) -> None:
        self.sessions, self._token, self._wanted = sessions, token, identity
        self.results: Results | None = None
        self.views: Views | None = None
        self.view = NAMES[0]
        self._version, self._reason, self._moves_focus = -1, '', False
        self._side: Sidebar | None = None
        self._build(document)
        document.on_event(DocumentReady, lambda event: self._on_ready())
        document.add_periodic_callback(self._tick, _POLL_MS)

    def close(self) -> None:
        """Detach the session; it remains for the next page."""
        self.sessions.detach(self)

    # Construction.

    def _build(self, document: Document) -> None:
        self.verdict, self.status = widgets.html('<h1>Opening …</h1>'), widgets.html('')
        self.cancel = widgets.button('Cancel', lambda: self._on_session(Session.cancel),
                                     name='cancel', visible=False, width=90)
        self.retry = widgets.button('Try again', lambda: self._on_session(Session.try_again),
                                    'primary', name='again', visible=False, width=110)
        self.browser = widgets.Browser()
        dark = widgets.button('Dark or light', lambda: None, name='style')
        dark.js_on_event('button_click', CustomJS(code=_TOGGLE_DARK))
        self.settings = column(widgets.html(''), sizing_mode='stretch_width')
        self.facts, self.earlier = widgets.html('', 'facts'), widgets.html('', 'earlier')
        self.missing, self.history, self.shown = (
            column(widgets.html(''), sizing_mode='stretch_width', name=name)
            for name in ('missing', 'history', 'shown'))
        head = column(self.verdict, row(self.status, self.cancel, self.retry,
                                        sizing_mode='stretch_width'),
                      self.browser.element, name='head', sizing_mode='stretch_width')
        side = column(dark, self.facts, self.settings, self.earlier, name='side',
                      sizing_mode='stretch_width')
        views = column(widgets.tabs(NAMES, self._on_tab), self.shown, name='views',
                       sizing_mode='stretch_width')
        for root in (head, side, self.missing, self.history, views):
            document.add_root(root)
        document.theme = THEME
        document.template = widgets.template(secrets.token_urlsafe(16))
        document.title = 'gravity_comp workbench'
        document.js_on_event('document_ready', CustomJS(code=_READY))

    def _on_ready(self) -> None:
        """Attach a session after the browser has drawn the page."""
        if self.results is not None:
            return
        session = self.sessions.attach(self._wanted, self)
        self.results = Results(session)
        self.browser.send('session', session.id)
        self.earlier.text = earlier_html(self.sessions.earlier(session.id), self._token)
        self._refresh(self.results)

    # Events.

    def _tick(self) -> None:
        results = self.results
        if results is None:
            return
        if results.session.page is not self:
            self._show_taken_over()
        elif results.session.version != self._version:
            self._refresh(results)
        else:
            self._update_status(results)

    def _show_taken_over(self) -> None:
        self.results = None
        self.verdict.text = ('<h1 id="taken">This session is open in another window. Reload this '
                             'page to continue here.</h1>')
        self.cancel.visible = self.retry.visible = False
        for place in (self.settings, self.missing, self.history, self.shown):
            place.children = [widgets.html('')]

    def _on_session(self, action: Callable[[Session], None]) -> None:
        if self.results is not None:
            action(self.results.session)

    def _add(self, targets: tuple[str, ...]) -> None:
        self._moves_focus = True
        self._on_session(lambda session: session.add(targets))

    def _on_tab(self, number: int) -> None:
        self.view = NAMES[number]
        self._show_view()

    # Display.

    def _refresh(self, results: Results) -> None:
        """Show a new state of the session."""
        session = results.session
        self._version = session.version
        self.facts.text = facts_html(session.read) if session.read else ''
        self._make_views(results)
        self._show_verdict(session)
        self.missing.children = panels.findings(results, self._add, self.browser)
        self.history.children = [*panels.history(results),
                                 *panels.request_controls(session)]
        self._show_view()
        self._fill_side(results)
        self._update_status(results)
        if self._moves_focus and session.worker.job is None:
            # The pressed button has been removed; move the focus to the result for screen readers.
            self.browser.send('focus', 'head')
            self._moves_focus = False

    def _make_views(self, results: Results) -> None:
        try:
            contents = results.contents()
        except GravityCompError as problem:
            self._reason = results.session.error or str(problem)
            self.views = None if results.session.read is None else self.views
            return
        if self.views is None or self.views.contents is not contents:
            self.views = Views(contents, self.views)

    def _show_verdict(self, session: Session) -> None:
        if self.views is None:
            text = 'gravity_comp workbench'
        elif session.stage is not None:
            text = markup.units(headline(self.views.contents))
        elif session.error:
            text = 'No model yet. The views compare with a constant torque.'
        else:
            text = 'Gravity is being fitted. The views compare with a constant torque.'
        self.verdict.text = f'<h1 id="verdict">{markup.text(text)}</h1>'

    def _fill_side(self, results: Results) -> None:
        session = results.session
        if session.read is None or self._side is not None and self._side.shows is session.choice:
            return
        self._side = Sidebar(results, self.browser)
        self.settings.children = [self._side.element]

    def _update_status(self, results: Results) -> None:
        session = results.session
        busy = session.worker.job is not None
        self.cancel.visible = busy
        self.retry.visible = bool(session.error) and not busy and session.next_job() is not None
        text = status_html(results)
        if self.status.text != text:
            self.status.text = text

    def _show_view(self) -> None:
        self.shown.children = [self._element()]

    def _element(self) -> UIElement:
        """Return the current view."""
        if self.results is None or self.views is None:
            return widgets.html(f'<h2 id="words">{markup.text(self._reason)}</h2>')
        try:
            view = self.views.show(self.view)
            others = self.results.others() if self.view == 'Errors' else {}
            return column(self._other(self.results, others), view,
                          sizing_mode='stretch_width') if others else view
        except Exception as problem:
            # A failure of one view must be reported on the page.
            _LOG.exception('the view %s failed', self.view)
            return widgets.html(markup.paragraph(
                f'This view cannot be drawn, please report it: {type(problem).__name__}: '
                f'{problem}', 'warning'))

    def _other(self, results: Results, others: Mapping[str, Stage]) -> Select:
        """Return the selector of the model to compare with."""
        def choose(name: str) -> None:
            results.other = name
            self._make_views(results)
            self._show_view()

        stage = results.session.stage
        first = 'the stage before' if stage is not None and stage.effects else 'no model'
        return widgets.select('Compare with', [('', first), *((name, name) for name in others)],
                              results.other if results.other in others else '', choose, 'other')


def status_html(results: Results) -> str:
    """Return the running job, the error, or the last result, with warnings."""
    session = results.session
    job, event = session.worker.job, session.progress
    # A fit of all samples and the settings may give the same warning: show it once.
    warnings = dict.fromkeys(filter(None, (
        session.save_error, session.warning, results.slow_warning(),
        *(session.stage.warnings if session.stage else ()))))
    below = ''.join(f'<p class="warning">{markup.text(text)}</p>' for text in warnings)
    if job is not None:
        stage = f': {event.stage}' if event else ''
        share = f' <progress max="1" value="{event.share:.2f}"></progress>' if event else ''
        return f'<p id="doing">{markup.text(str(job) + stage)} …{share}</p>{below}'
    if session.error:
        return f'<p id="trouble" class="warning">{markup.text(session.error)}</p>{below}'
    return f'<p id="idle" class="quiet">{markup.text(session.done or "Ready")}</p>{below}'


def facts_html(read: ReadResult) -> str:
    """Return the facts of each recording, and of all together, a line each; '' without facts."""
    lines = [(f'{report.path.name}:', fact) for report in read.reports for fact in report.facts]
    lines += [('', fact) for fact in read.facts]
    if not lines:
        return ''
    listed = ''.join(
        f'<li class="{"warning" if fact.action is Action.REFUSED else "quiet"}">'
        f'{markup.text(name)} {"refused: " * (fact.action is Action.REFUSED)}'
        f'{markup.text(fact.sentence)}</li>' for name, fact in lines)
    return f'<details id="facts" open><summary>Facts of the recordings ({len(lines)})</summary>' \
           f'<ul>{listed}</ul></details>'


def earlier_html(saved: Sequence[Entry], token: str) -> str:
    """Return links to sessions that can be resumed."""
    if not saved:
        return ''
    lines = ''.join(
        f'<li><a href="?{ARGUMENT}={token}&amp;session={markup.text(entry.id)}">'
        f'{markup.text(", ".join(entry.recordings))}</a><br>'
        f'<span class="quiet">{markup.text(entry.changed[:16].replace("T", " "))}, '
        f'{markup.text(", ".join(entry.stages[-3:]))}</span></li>' for entry in saved)
    return f'<details id="earlier"><summary>Earlier sessions ({len(saved)})</summary>' \
           f'<ul>{lines}</ul></details>'


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
