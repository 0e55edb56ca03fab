"""The workbench page: settings in the side bar, findings and error history above the views."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import logging

from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.layouts import column, row
from bokeh.models import CustomJS, UIElement
from gravity_comp_ros.errors import DataError, GravityCompError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.headline import headline, largest
from gravity_comp_ros.report.page import report_html
from gravity_comp_ros.report.sections import SECTIONS
from gravity_comp_ros.report.style import DARK, LIGHT, Style
from gravity_comp_ros.workbench import (
    findings_panel, page_parts, page_style, plan_panel, store, widgets)
from gravity_comp_ros.workbench.choice import Choice
from gravity_comp_ros.workbench.history_panel import HistoryPanel
from gravity_comp_ros.workbench.open_session import OpenSession
from gravity_comp_ros.workbench.pair_view import PairView
from gravity_comp_ros.workbench.plan_panel import PlanActions
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.sessions import Sessions
from gravity_comp_ros.workbench.sidebar import Actions, Sidebar
from gravity_comp_ros.workbench.views import Views

_LOG = logging.getLogger(__name__)
_POLL_MS = 100
COMPARE = 'Two models'
NAMES = (*SECTIONS, COMPARE)


class Page:
    """
    The page of one browser window. It attaches a session after the browser has drawn the page.

    :param identity: session id in the URL; an unknown id gives a new session.
    """

    def __init__(self, document: Document, sessions: Sessions, identity: str,
                 nonce: str) -> None:
        self.document, self.sessions, self._wanted = document, sessions, identity
        self.opened: OpenSession | None = None
        self.style: Style = LIGHT
        self.views: Views | None = None
        self.pair = PairView()
        self._side: Sidebar | None = None
        self._version, self._collections, self._focus = -1, 0, ''
        self._outdated = False
        self.view = NAMES[0]
        self._build(nonce)
        document.on_event(DocumentReady, lambda event: self._on_ready())
        document.add_periodic_callback(self._tick, _POLL_MS)

    def close(self) -> None:
        """Detach the session; it remains for the next page."""
        self.sessions.detach(self)

    # Construction.

    def _build(self, nonce: str) -> None:
        self.verdict, self.status = widgets.html('', 'verdict'), widgets.html('', 'status')
        self.cancel = widgets.button('Cancel', self._cancel, name='cancel', visible=False,
                                     width=90)
        self.retry = widgets.button('Try again', self._try_again, 'primary', name='again',
                                    visible=False, width=110)
        self.downloads = page_parts.Downloads()
        self.side = column(sizing_mode='stretch_width', name='side')
        self.missing, self.history, self.shown = (
            column(widgets.html(''), sizing_mode='stretch_width', name=name)
            for name in ('missing', 'history', 'shown'))
        self._history = HistoryPanel()
        self.earlier = widgets.html('', 'earlier')
        self.tabs = widgets.tabs(NAMES, self._on_tab)
        self.dark = widgets.button('Dark', self._toggle_style, name='style')
        self.dark.js_on_event('button_click', CustomJS(code=page_parts.TOGGLE_DARK))
        self.link = page_parts.client_link(self._on_client_message)
        head = column(self.verdict, row(self.status, self.cancel, self.retry,
                                        sizing_mode='stretch_width'),
                      self.downloads.element, self.link, name='head', sizing_mode='stretch_width')
        views = column(self.tabs, self.shown, name='views', sizing_mode='stretch_width')
        self.side.children = [self.dark]
        for root in (head, self.side, self.missing, self.history, views):
            self.document.add_root(root)
        self.document.template = page_style.template(nonce)
        self.document.title = 'gravity_comp workbench'
        self.document.js_on_event('document_ready', CustomJS(
            args={'link': self.link}, code=page_parts.READY))
        self.verdict.text = '<h1>Opening …</h1>'

    def _on_ready(self) -> None:
        """Attach a session after the browser has drawn the page."""
        if self.opened is not None:
            return
        self.opened = self.sessions.attach(self._wanted, self)
        self.link.tags = ['session', self.opened.id]
        self._list_earlier()
        self._refresh()

    def _list_earlier(self) -> None:
        saved = self.sessions.earlier(self.opened.id if self.opened else '')
        self.earlier.text = page_parts.earlier_html(saved)

    def _on_client_message(self, what: str) -> None:
        if what == 'dark' and self.style is LIGHT:
            self._toggle_style()

    # Events.

    def _tick(self) -> None:
        opened = self.opened
        if opened is not None and opened.page is not self:
            self._show_taken_over()
            return
        if opened is not None:
            if opened.version != self._version:
                self._refresh()
            elif self._outdated:
                self._show(opened)
            else:
                self._update_status(opened)
            if self.views is not None:
                self.views.table.follow_window()

    def _show_taken_over(self) -> None:
        text = 'This session is open in another window.'
        if text not in self.verdict.text:
            self.verdict.text = f'<h1 id="taken">{text} Reload this page to continue here.</h1>'
            self.cancel.visible = self.retry.visible = False
            self.side.children = [self.dark]
            for place in (self.missing, self.history, self.shown):
                place.children = [widgets.html('')]

    def _cancel(self) -> None:
        if self.opened is not None:
            self.opened.cancel()

    def _try_again(self) -> None:
        if self.opened is not None:
            self.opened.try_again()

    def _with_choice(self, action: Callable[[OpenSession, Choice], None]) -> None:
        if self.opened is None or self._side is None:
            return
        try:
            action(self.opened, self._side.choice())
        except GravityCompError as problem:
            self._warn(str(problem))

    def _warn(self, reason: str) -> None:
        if self.opened is not None:
            self.opened.warning = reason
            self._update_status(self.opened)

    def _add(self, targets: tuple[str, ...]) -> None:
        if self.opened is not None:
            self._focus = 'head'
            self.opened.add(targets)

    def _on_tab(self, number: int) -> None:
        self.view = NAMES[number]
        self._show_view()

    def _toggle_style(self) -> None:
        self.style = DARK if self.style is LIGHT else LIGHT
        self.dark.label = 'Light' if self.style is DARK else 'Dark'
        if self.opened is not None:
            self._refresh()

    # Display.

    def _refresh(self) -> None:
        opened = self.opened
        if opened is None:
            return
        self._version = opened.version
        self._fill_side(opened)
        plans = PlanActions(opened.plan, self.downloads.give)
        self.missing.children = findings_panel.parts(opened, self._add, plans)
        self.history.children = [*self._history.parts(opened, self.style),
                                 *plan_panel.request_controls(opened, plans)]
        # Send the errors of a new model first, because its views take longer.
        stage = opened.session.stage
        self._outdated = self.views is not None and stage is not None \
            and self.views.contents.model is not stage.model
        if not self._outdated:
            self._show(opened)

    def _show(self, opened: OpenSession) -> None:
        """Show the verdict and the current view."""
        self._outdated = False
        self._make_views(opened)
        self._update_status(opened)
        self._show_verdict(opened)
        self._show_view()
        if self._focus and not opened.worker.busy:
            # The pressed button has been removed; move the focus to the result for screen readers.
            self.link.tags = ['focus', self._focus, str(opened.version)]
            self._focus = ''

    def _make_views(self, opened: OpenSession) -> None:
        session = opened.session
        selected = self.views.table.selected if self.views else []
        if session.read is None:
            self.views = None
            return
        try:
            ready = session.stage is not None and session.read_with == \
                session.choice.reading(session.topic)
            contents = session.contents() if ready else session.preview()
        except GravityCompError as problem:
            self.views = None
            opened.warning = str(problem)
            return
        if self.views is None or self.views.contents is not contents \
                or self.views.style is not self.style:
            self.views = Views(contents, self.style, selected)

    def _fill_side(self, opened: OpenSession) -> None:
        if opened.session.read is None:
            return
        actions = Actions(
            partial(self._with_choice, OpenSession.learn),
            partial(self._with_choice, OpenSession.evaluate),
            lambda: self._export('arm.json', 'application/json',
                                 lambda session, model: store.model_text(model)),
            lambda: self._export('report.html', 'text/html', self._report),
            lambda: self._export('workbench.sh', 'text/x-shellscript', lambda session, model:
                                 '\n'.join(['#!/bin/sh', 'set -e', *session.commands(), ''])))
        if self._side is None or self._side.shows is not opened.session.choice:
            self._side = Sidebar(opened.session, actions)
            self.side.children = [self.dark, self._side.element, self.earlier]

    def _update_status(self, opened: OpenSession) -> None:
        self.cancel.visible = opened.worker.busy
        self.retry.visible = bool(opened.error) and not opened.worker.busy \
            and opened.session.next_job() is not None
        text = page_parts.status_html(opened)
        if self.status.text != text:
            self.status.text = text

    def _show_verdict(self, opened: OpenSession) -> None:
        stage = opened.session.stage
        if self.views is None:
            self.verdict.text = '<h1>gravity_comp workbench</h1>'
        elif stage is None:
            self.verdict.text = '<h1>Gravity is being fitted. The views compare with a ' \
                'constant torque.</h1>' if not opened.error else \
                '<h1>No model yet. The views compare with a constant torque.</h1>'
        else:
            contents = self.views.contents
            text = headline(contents) if contents.diagnosis else f'{largest(contents)}.'
            self.verdict.text = f'<h1 id="verdict">{markup.text(markup.units(text))}</h1>'

    def _show_view(self) -> None:
        self.shown.children = [self._element()]
        self._collections += 1
        self.link.tags = ['collect', str(self._collections)]

    def _element(self) -> UIElement:
        if self.opened is None or self.views is None:
            text = (self.opened.error if self.opened else '') or \
                'The views appear when the recordings have been read.'
            return widgets.html(f'<h2 id="words">{markup.text(text)}</h2>')
        try:
            if self.view == COMPARE:
                return self.pair.show(self.opened, self.style)
            return self.views.show(self.view)
        except Exception as problem:
            # A failure of one view must be reported on the page.
            _LOG.exception('the view %s failed', self.view)
            return widgets.html(markup.paragraph(
                f'This view cannot be drawn, please report it: {type(problem).__name__}: '
                f'{problem}', 'warning'))

    # Downloads.

    def _export(self, name: str, kind: str, make: Callable[[Session, GravityModel], str]) -> None:
        """Download a file made from the current model."""
        session = self.opened.session if self.opened else None
        if session is None or session.stage is None:
            self._warn('there is no model yet')
            return
        try:
            self.downloads.give(name, kind, make(session, session.stage.model))
        except GravityCompError as problem:
            self._warn(str(problem))

    def _report(self, session: Session, model: GravityModel) -> str:
        if self._outdated and self.opened is not None:
            self._show(self.opened)
        if self.views is None:
            raise DataError('there is no model yet')
        return report_html(self.views.contents)
