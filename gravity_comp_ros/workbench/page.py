"""The page: choices at the side, what is missing and the error so far above, views below."""

from __future__ import annotations

from collections.abc import Callable
import logging
from typing import TYPE_CHECKING

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
from gravity_comp_ros.workbench.history_panel import HistoryPanel
from gravity_comp_ros.workbench.live_view import LiveView
from gravity_comp_ros.workbench.open_session import OpenSession
from gravity_comp_ros.workbench.pair_view import PairView
from gravity_comp_ros.workbench.plan_panel import PlanActions
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.sessions import Sessions
from gravity_comp_ros.workbench.sidebar import Actions, Sidebar
from gravity_comp_ros.workbench.views import Views

if TYPE_CHECKING:
    from gravity_comp_ros.node.node_client import Following

_LOG = logging.getLogger(__name__)
_POLL_MS = 100
COMPARE, LIVE = 'Two models', 'Live'


class Page:
    """
    One browser window's page. It gets a session when a browser is really there, not before.

    :param identity: the session that the address asks for; a new one is made for others.
    """

    def __init__(self, document: Document, sessions: Sessions, identity: str, has_bags: bool,
                 follower: Following | None, nonce: str) -> None:
        self.document, self.sessions, self._wanted = document, sessions, identity
        self.one: OpenSession | None = None
        self.style: Style = LIGHT
        self.views: Views | None = None
        self.pair = PairView()
        self._side: Sidebar | None = None
        self._seen, self._sweeps, self._focus = -1, 0, ''
        self._outdated = False
        self.live = LiveView(follower, self.style) if follower else None
        self.names = [*((*SECTIONS, COMPARE) if has_bags else ()), *((LIVE,) if follower else ())]
        self.view = self.names[0]
        self._has_bags = has_bags
        self._build(nonce)
        document.on_event(DocumentReady, lambda event: self._arrived())
        document.add_periodic_callback(self._tick, _POLL_MS)

    def close(self) -> None:
        """Leave the session; it stays for the page that comes next."""
        self.sessions.detach(self)

    # What the page is made of.

    def _build(self, nonce: str) -> None:
        self.verdict, self.status = widgets.html('', 'verdict'), widgets.html('', 'status')
        self.cancel = widgets.button('Cancel', self._cancel, name='cancel', visible=False,
                                     width=90)
        self.again = widgets.button('Try again', self._try_again, 'primary', name='again',
                                    visible=False, width=110)
        self.downloads = page_parts.Downloads()
        self.side = column(sizing_mode='stretch_width', name='side')
        self.missing, self.history, self.shown = (
            column(widgets.html(''), sizing_mode='stretch_width', name=name)
            for name in ('missing', 'history', 'shown'))
        self._history = HistoryPanel()
        self.earlier = widgets.html('', 'earlier')
        self.tabs = widgets.tabs(self.names, self._look)
        self.dark = widgets.button('Dark', self._turn_style, name='style')
        self.dark.js_on_event('button_click', CustomJS(code=page_parts.TURN_DARK))
        self.link = page_parts.client_link(self._told_by_client)
        head = column(self.verdict, row(self.status, self.cancel, self.again,
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

    def _arrived(self) -> None:
        """Take up a session: a browser is there and has drawn the page."""
        if self.one is not None:
            return
        if not self._has_bags:
            self.verdict.text = ''
            self._show_view()
            return
        self.one = self.sessions.attach(self._wanted, self)
        self.link.tags = ['session', self.one.id]
        self._list_earlier()
        self._refresh()

    def _list_earlier(self) -> None:
        saved = self.sessions.earlier(self.one.id if self.one else '')
        self.earlier.text = page_parts.earlier_html(saved)

    def _told_by_client(self, what: str) -> None:
        if what == 'dark' and self.style is LIGHT:
            self._turn_style()

    # What happens.

    def _tick(self) -> None:
        one = self.one
        if one is not None and one.page is not self:
            self._taken()
            return
        if one is not None:
            if one.version != self._seen:
                self._refresh()
            elif self._outdated:
                self._show(one)
            else:
                self._say(one)
            if self.views is not None:
                self.views.table.follow_window()
        if self.live is not None:
            self.live.update(self.view == LIVE)

    def _taken(self) -> None:
        words = 'This session is open in another window.'
        if words not in self.verdict.text:
            self.verdict.text = f'<h1 id="taken">{words} Reload this page to go on here.</h1>'
            self.cancel.visible = self.again.visible = False
            self.side.children = [self.dark]
            for place in (self.missing, self.history, self.shown):
                place.children = [widgets.html('')]

    def _cancel(self) -> None:
        if self.one is not None:
            self.one.cancel()

    def _try_again(self) -> None:
        if self.one is not None:
            self.one.try_again()

    def _learn(self) -> None:
        self._with_choice(lambda one, side: one.learn(side.choice()))

    def _judge(self) -> None:
        self._with_choice(lambda one, side: one.judge(side.choice()))

    def _with_choice(self, action: page_parts.WithChoice) -> None:
        if self.one is None or self._side is None:
            return
        try:
            action(self.one, self._side)
        except GravityCompError as problem:
            self._complain(str(problem))

    def _complain(self, reason: str) -> None:
        if self.one is not None:
            self.one.warning = reason
            self._say(self.one)

    def _add(self, targets: tuple[str, ...]) -> None:
        if self.one is not None:
            self._focus = 'head'
            self.one.add(targets)

    def _look(self, number: int) -> None:
        self.view = self.names[number]
        self._show_view()

    def _turn_style(self) -> None:
        self.style = DARK if self.style is LIGHT else LIGHT
        self.dark.label = 'Light' if self.style is DARK else 'Dark'
        if self.live is not None:
            self.live.dress(self.style)
        if self.one is not None:
            self._refresh()

    # What is shown.

    def _refresh(self) -> None:
        one = self.one
        if one is None:
            return
        self._seen = one.version
        self._fill_side(one)
        plans = PlanActions(one.plan, self.downloads.give)
        self.missing.children = findings_panel.parts(one, self._add, plans)
        self.history.children = [*self._history.parts(one, self.style),
                                 *plan_panel.asking(one, plans)]
        # The numbers of a new model go out first: its views take their time.
        stage = one.session.stage
        self._outdated = self.views is not None and stage is not None \
            and self.views.contents.model is not stage.model
        if not self._outdated:
            self._show(one)

    def _show(self, one: OpenSession) -> None:
        """Show the verdict and the view of what is there now."""
        self._outdated = False
        self._make_views(one)
        self._say(one)
        self._show_verdict(one)
        self._show_view()
        if self._focus and not one.worker.busy:
            # The button that was pressed is gone; a reader of the screen goes on from the answer.
            self.link.tags = ['focus', self._focus, str(one.version)]
            self._focus = ''

    def _make_views(self, one: OpenSession) -> None:
        session = one.session
        selected = self.views.table.selected if self.views else []
        if session.read is None:
            self.views = None
            return
        try:
            ready = session.stage is not None and session.read_with == \
                session.choice.reading(session.topic)
            found = session.contents() if ready else session.preview()
        except GravityCompError as problem:
            self.views = None
            one.warning = str(problem)
            return
        if self.views is None or self.views.contents is not found \
                or self.views.style is not self.style:
            self.views = Views(found, self.style, selected)

    def _fill_side(self, one: OpenSession) -> None:
        if one.session.read is None:
            return
        actions = Actions(
            self._learn, self._judge,
            lambda: self._export('arm.json', 'application/json',
                                 lambda session, model: store.model_text(model)),
            lambda: self._export('report.html', 'text/html', self._report),
            lambda: self._export('workbench.sh', 'text/x-shellscript', lambda session, model:
                                 '\n'.join(['#!/bin/sh', 'set -e', *session.commands(), ''])))
        if self._side is None or self._side.shows is not one.session.choice:
            self._side = Sidebar(one.session, actions)
            self.side.children = [self.dark, self._side.element, self.earlier]

    def _say(self, one: OpenSession) -> None:
        self.cancel.visible = one.worker.busy
        self.again.visible = bool(one.trouble) and not one.worker.busy \
            and one.session.next_job() is not None
        text = page_parts.status_html(one)
        if self.status.text != text:
            self.status.text = text

    def _show_verdict(self, one: OpenSession) -> None:
        stage = one.session.stage
        if self.views is None:
            self.verdict.text = '<h1>gravity_comp workbench</h1>'
        elif stage is None:
            self.verdict.text = '<h1>Gravity is being learned. So far the views compare with a ' \
                'constant torque.</h1>' if not one.trouble else \
                '<h1>No model yet. The views compare with a constant torque.</h1>'
        else:
            found = self.views.contents
            told = headline(found) if found.diagnosis else f'{largest(found)}.'
            self.verdict.text = f'<h1 id="verdict">{markup.text(markup.units(told))}</h1>'

    def _show_view(self) -> None:
        self.shown.children = [self._element()]
        self._sweeps += 1
        self.link.tags = ['sweep', str(self._sweeps)]

    def _element(self) -> UIElement:
        if self.view == LIVE and self.live is not None:
            return self.live.element
        if self.one is None or self.views is None:
            words = (self.one.trouble if self.one else '') or 'The views appear as soon as the ' \
                'recordings are read.'
            return widgets.html(f'<h2 id="words">{markup.text(words)}</h2>')
        try:
            if self.view == COMPARE:
                return self.pair.show(self.one, self.style)
            return self.views.show(self.view)
        except Exception as problem:
            # A fault of one view must not leave the page as it was, without a word.
            _LOG.exception('the view %s failed', self.view)
            return widgets.html(markup.paragraph(
                f'This view cannot be drawn, please report it: {type(problem).__name__}: '
                f'{problem}', 'warning'))

    # What goes out.

    def _export(self, name: str, kind: str, make: Callable[[Session, GravityModel], str]) -> None:
        """Hand out a file of what there is of the present model."""
        session = self.one.session if self.one else None
        if session is None or session.stage is None:
            self._complain('there is no model yet')
            return
        try:
            self.downloads.give(name, kind, make(session, session.stage.model))
        except GravityCompError as problem:
            self._complain(str(problem))

    def _report(self, session: Session, model: GravityModel) -> str:
        if self._outdated and self.one is not None:
            self._show(self.one)
        if self.views is None:
            raise DataError('there is no model yet')
        return report_html(self.views.contents)
