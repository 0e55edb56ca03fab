"""The workbench page: settings in the side bar, findings and error history above the views."""

from __future__ import annotations

from collections.abc import Callable
import logging
import secrets

from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.layouts import column, row
from bokeh.models import CustomJS, UIElement
from gravity_comp_ros.errors import DataError, GravityCompError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.page import report_html, SECTIONS
from gravity_comp_ros.report.style import THEME
from gravity_comp_ros.report.views.summary import headline
from gravity_comp_ros.workbench import findings_panel, page_parts, store, widgets
from gravity_comp_ros.workbench.findings_panel import PlanActions
from gravity_comp_ros.workbench.history_panel import HistoryPanel
from gravity_comp_ros.workbench.results import Results
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.sessions import Sessions
from gravity_comp_ros.workbench.sidebar import Actions, Sidebar
from gravity_comp_ros.workbench.stages import Choice
from gravity_comp_ros.workbench.views import TwoModels, Views

_LOG = logging.getLogger(__name__)
_POLL_MS = 100
COMPARE = 'Two models'
NAMES = (*SECTIONS, COMPARE)


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
        self._history, self._two = HistoryPanel(), TwoModels()
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
        self.downloads, self.link = page_parts.Downloads(), page_parts.client_link()
        dark = widgets.button('Dark or light', lambda: None, name='style')
        dark.js_on_event('button_click', CustomJS(code=page_parts.TOGGLE_DARK))
        self.settings = column(widgets.html(''), sizing_mode='stretch_width')
        self.facts, self.earlier = widgets.html('', 'facts'), widgets.html('', 'earlier')
        self.missing, self.history, self.shown = (
            column(widgets.html(''), sizing_mode='stretch_width', name=name)
            for name in ('missing', 'history', 'shown'))
        head = column(self.verdict, row(self.status, self.cancel, self.retry,
                                        sizing_mode='stretch_width'),
                      self.downloads.element, self.link, name='head', sizing_mode='stretch_width')
        side = column(dark, self.facts, self.settings, self.earlier, name='side',
                      sizing_mode='stretch_width')
        views = column(widgets.tabs(NAMES, self._on_tab), self.shown, name='views',
                       sizing_mode='stretch_width')
        for root in (head, side, self.missing, self.history, views):
            document.add_root(root)
        document.theme = THEME
        document.template = widgets.template(secrets.token_urlsafe(16))
        document.title = 'gravity_comp workbench'
        document.js_on_event('document_ready', CustomJS(code=page_parts.READY))

    def _on_ready(self) -> None:
        """Attach a session after the browser has drawn the page."""
        if self.results is not None:
            return
        try:
            session = self.sessions.attach(self._wanted, self)
        except GravityCompError as problem:
            self.verdict.text = f'<h1 id="words">{markup.text(problem)}</h1>'
            return
        self.results = Results(session)
        self.link.tags = ['session', session.id]
        self.earlier.text = page_parts.earlier_html(self.sessions.earlier(session.id),
                                                    self._token)
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

    def _with_choice(self, action: Callable[[Session, Choice], None]) -> None:
        def act(session: Session) -> None:
            if self._side is None:
                return
            try:
                action(session, self._side.choice())
            except GravityCompError as problem:
                self._warn(session, str(problem))
        self._on_session(act)

    def _warn(self, session: Session, reason: str) -> None:
        session.warning = reason
        session.version += 1

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
        self.facts.text = page_parts.facts_html(session.read.reports if session.read else ())
        self._make_views(results)
        self._show_verdict(session)
        plans = PlanActions(session.request_plan, self.downloads.give)
        self.missing.children = findings_panel.parts(results, self._add, plans)
        self.history.children = [*self._history.parts(results),
                                 *findings_panel.request_controls(session, plans)]
        self._show_view()
        self._fill_side(session)
        self._update_status(results)
        if self._moves_focus and session.worker.job is None:
            # The pressed button has been removed; move the focus to the result for screen readers.
            self.link.tags = ['focus', 'head', str(session.version)]
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
            self.views.selector.select.on_change(
                'value', lambda attribute, old, new: self._show_view())

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

    def _fill_side(self, session: Session) -> None:
        if session.read is None or self._side is not None and self._side.shows is session.choice:
            return
        self._side = Sidebar(session, Actions(
            lambda: self._with_choice(Session.learn), lambda: self._with_choice(Session.evaluate),
            lambda: self._export('arm.json', 'application/json',
                                 lambda results, model: store.model_text(model)),
            lambda: self._export('report.html', 'text/html',
                                 lambda results, model: report_html(results.contents())),
            lambda: self._export(
                'workbench.sh', 'text/x-shellscript', lambda results, model: '\n'.join(
                    ['#!/bin/sh', 'set -e', *results.commands(), '']))))
        self.settings.children = [self._side.element]

    def _update_status(self, results: Results) -> None:
        session = results.session
        busy = session.worker.job is not None
        self.cancel.visible = busy
        self.retry.visible = bool(session.error) and not busy and session.next_job() is not None
        text = page_parts.status_html(results)
        if self.status.text != text:
            self.status.text = text

    def _show_view(self) -> None:
        self.shown.children = [self._element()]

    def _element(self) -> UIElement:
        """Return the current view."""
        if self.results is None or self.views is None:
            return widgets.html(f'<h2 id="words">{markup.text(self._reason)}</h2>')
        try:
            if self.view == COMPARE:
                return self._two.show(self.results)
            return self.views.show(self.view)
        except Exception as problem:
            # A failure of one view must be reported on the page.
            _LOG.exception('the view %s failed', self.view)
            return widgets.html(markup.paragraph(
                f'This view cannot be drawn, please report it: {type(problem).__name__}: '
                f'{problem}', 'warning'))

    def _export(self, name: str, kind: str,
                make: Callable[[Results, GravityModel], str]) -> None:
        """Download a file made from the current model."""
        results = self.results
        if results is None:
            return
        try:
            stage = results.session.stage
            if stage is None:
                raise DataError('there is no model yet')
            self.downloads.give(name, kind, make(results, stage.model))
        except GravityCompError as problem:
            self._warn(results.session, str(problem))
