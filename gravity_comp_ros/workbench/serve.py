"""
Server of the workbench: the page, what it shows, requests, views and files.

Every user of this machine can reach the port. Every request needs the token in the address, which
only the terminal of the workbench shows, and only pages of this server may change anything.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from hmac import compare_digest
import json
import logging
from pathlib import Path
import secrets
import signal
import sys
import tempfile
import time
from typing import Any
import urllib.parse
import webbrowser

from gravity_comp_ros.errors import GravityCompError, OptionError
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.page import report_html, SECTIONS
from gravity_comp_ros.workbench.page import Page
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.widgets import page_html
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop, PeriodicCallback
from tornado.netutil import bind_sockets
from tornado.web import Application, RequestHandler

_LOG = logging.getLogger(__name__)
_LOCAL = ('127.0.0.1', 'localhost')
_POLL_MS = 100
# Longest wait, in s, for a change to show; the browser asks again. It has six connections at most.
_MAX_WAIT = 5.0

_HEADERS = {'X-Content-Type-Options': 'nosniff', 'X-Frame-Options': 'SAMEORIGIN',
            'Referrer-Policy': 'no-referrer', 'Cross-Origin-Resource-Policy': 'same-origin',
            'Cross-Origin-Opener-Policy': 'same-origin', 'Cache-Control': 'no-store',
            'Content-Security-Policy': "frame-ancestors 'self'"}


class _Handler(RequestHandler):
    """A request with the token of the server."""

    def initialize(self, page: Page, token: str) -> None:
        """Store what all requests share."""
        self.page, self.token = page, token

    def set_default_headers(self) -> None:
        """Set the headers of every answer."""
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Refuse a request without the token, or a change from another site."""
        given = self.get_query_argument('token', '')
        origin = urllib.parse.urlsplit(self.request.headers.get('Origin', '')).netloc
        if not compare_digest(given.encode(), self.token.encode()):
            self.refuse(403, 'open the address that the terminal of the workbench shows: it '
                             'contains a token')
        elif self.request.method not in ('GET', 'HEAD') and origin != self.request.host:
            self.refuse(403, 'only this page may change anything')

    def refuse(self, status: int, reason: str) -> None:
        """End the request with a line of text."""
        self.set_status(status)
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(reason)


class _Start(_Handler):
    def get(self) -> None:
        """Send the page."""
        self.finish(page_html())


class _Shown(_Handler):
    async def get(self) -> None:
        """Send what the page shows as soon as it differs from what the browser has."""
        page = self.page
        end = time.monotonic() + _MAX_WAIT
        page.session.start()
        while page.tag == self.get_query_argument('tag', '') and time.monotonic() < end:
            await asyncio.sleep(1e-3 * _POLL_MS)
        self.finish({'tag': page.tag, **page.parts()})


class _Act(_Handler):
    def post(self) -> None:
        """Do what a button or a drop-down list requests."""
        page = self.page
        try:
            request = json.loads(self.request.body)
            form: dict[str, list[str]] = {}
            for name, value in request['form']:
                form.setdefault(name, []).append(value)
            page.act(request['what'], request['value'], form)
        except GravityCompError as problem:
            page.session.warn(str(problem))
        except (KeyError, TypeError, ValueError, IndexError):
            self.refuse(400, 'there is no such request')


class _View(_Handler):
    async def get(self) -> None:
        """Send a view of the report; another thread makes it."""
        contents, name = self.page.contents, self.get_query_argument('view', '')
        if contents is None or name not in SECTIONS:
            self.refuse(404, 'there is no such view')
            return
        try:
            html = await IOLoop.current().run_in_executor(None, report_html, contents, (name,))
        except Exception as problem:
            # A failure of one view must be reported on the page.
            _LOG.exception('the view %s failed', name)
            html = markup.html_page(name, markup.paragraph(
                f'This view cannot be drawn, please report it: {type(problem).__name__}: '
                f'{problem}', 'warning'))
        self.finish(html)


class _File(_Handler):
    async def get(self, name: str) -> None:
        """Send a file made of the current model."""
        page = self.page
        try:
            text = await IOLoop.current().run_in_executor(None, page.file(name))
        except KeyError:
            self.refuse(404, f'there is no {name} yet')
            return
        self.set_header('Content-Type', 'application/octet-stream')
        self.set_header('Content-Disposition', f'attachment; filename="{name}"')
        self.finish(text)


def serve(session: Session, host: str, port: int, browser: bool) -> None:
    """
    Serve until interrupted.

    :param browser: whether to open the page in a browser.
    :raises OptionError: if the address is not available.
    """
    token = secrets.token_urlsafe(24)
    loop = IOLoop.current()
    server, port = make_server(host, port, Page(session), token)
    polling = PeriodicCallback(session.poll, _POLL_MS)
    polling.start()
    # The loop handles the signal between callbacks, so no callback is interrupted.
    loop.asyncio_loop.add_signal_handler(signal.SIGINT, loop.stop)  # type: ignore[attr-defined]
    here = host if host in _LOCAL else '127.0.0.1'
    address = f'http://{here}:{port}/?token={token}'
    print(f'workbench at {address} (Ctrl-C to stop)', flush=True)
    if host not in _LOCAL:
        print(f'warning: served on {host} without encryption: the token and the '
              f'recordings can be read on the network', file=sys.stderr, flush=True)
    try:
        with _redirection(address) as page:
            if browser:
                loop.add_callback(webbrowser.open, page.as_uri())
            loop.start()
    finally:
        polling.stop()
        server.stop()
        session.worker.rest()


def make_server(host: str, port: int, page: Page, token: str) -> tuple[HTTPServer, int]:
    """
    Return a running server, and its port; port 0 is any free one.

    :raises OptionError: if the address is not available.
    """
    try:
        sockets = bind_sockets(port, host)
    except OSError as problem:
        reason = (problem.strerror or str(problem)).lower()
        raise OptionError(f'cannot serve on {host}, port {port}: {reason}; choose another with '
                          f'--port, or 0 for any free port') from problem
    shared: Mapping[str, Any] = {'page': page, 'token': token}
    server = HTTPServer(Application(
        [('/', _Start, shared), ('/shown', _Shown, shared), ('/act', _Act, shared),
         ('/view', _View, shared), (r'/file/([\w.]+)', _File, shared)],
        log_function=lambda handler: None))
    server.add_sockets(sockets)
    return server, sockets[0].getsockname()[1]


@contextmanager
def _redirection(address: str) -> Iterator[Path]:
    """Yield a page for the browser, whose command line other users can see without the token."""
    with tempfile.TemporaryDirectory(prefix='gravity_comp') as name:
        page = Path(name) / 'workbench.html'
        page.write_text(f'<meta http-equiv="refresh" content="0; url={address}">')
        yield page
