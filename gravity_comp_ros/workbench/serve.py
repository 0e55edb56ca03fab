"""Server of the workbench page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import errno
import logging
from pathlib import Path
import secrets
import signal
import sys
import tempfile
import warnings
import webbrowser

from bokeh.application import Application
from bokeh.application.application import SessionContext
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.util import bind_sockets
from bokeh.util.warnings import BokehUserWarning
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.workbench.access import (
    ARGUMENT, TokenApplication, UploadHandler, websocket_origins)
from gravity_comp_ros.workbench.page import Page
from gravity_comp_ros.workbench.session import Sessions
from gravity_comp_ros.workbench.store import State
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop, PeriodicCallback

_LOCAL = ('127.0.0.1', 'localhost')
_POLL_MS = 100
# Time, in ms, after which a closed page is discarded; its session remains.
_UNUSED_MS = 15000
# Loggers of Bokeh and Tornado for messages of a page.
LOGGERS = ('bokeh.server.protocol_handler', 'tornado.application', 'asyncio')


def is_of_an_open_page(record: logging.LogRecord) -> bool:
    """
    Return whether to show a log record; an assertion of Bokeh is not shown.

    A page may close while its messages are handled. Bokeh then misses the session of the page.
    """
    return not (record.exc_info and isinstance(record.exc_info[1], AssertionError))


def serve(state: State, place: Path | None, host: str, port: int, browser: bool) -> None:
    """
    Serve until interrupted.

    :param state: that of a new session.
    :param place: folder of saved sessions; None to save none.
    :param browser: whether to open the page in a browser.
    :raises OptionError: if the address is not available.
    """
    # A browser returns a model that it has just received; this is harmless.
    warnings.filterwarnings('ignore', 'reference already known', BokehUserWarning)
    # A page may be closed while a message is sent to it.
    logging.getLogger('bokeh.server.views.ws').setLevel(logging.ERROR)
    for name in LOGGERS:
        logging.getLogger(name).addFilter(is_of_an_open_page)
    sessions, token = Sessions(state, place), secrets.token_urlsafe(24)

    def open_page(document: Document) -> None:
        page = Page(document, sessions, token, _argument(document, 'session'))

        def ended(context: SessionContext) -> None:
            page.close()

        document.on_session_destroyed(ended)

    server = make_server(host, port, Application(FunctionHandler(open_page)),
                         sessions, token)
    polling = PeriodicCallback(sessions.poll, _POLL_MS)
    polling.start()
    # The loop handles the signal between callbacks, so no callback is interrupted.
    server.io_loop.asyncio_loop.add_signal_handler(  # type: ignore[attr-defined]
        signal.SIGINT, server.io_loop.stop)
    here = host if host in _LOCAL else '127.0.0.1'
    address = f'http://{here}:{server.port}/?{ARGUMENT}={token}'
    print(f'workbench at {address} (Ctrl-C to stop)', flush=True)
    if host not in _LOCAL:
        print(f'warning: served on {host} without encryption: the token and the '
              f'recordings can be read on the network', file=sys.stderr, flush=True)
    try:
        if browser:
            with _redirection(address) as page:
                server.io_loop.add_callback(webbrowser.open, page.as_uri())
                server.run_until_shutdown()
        else:
            server.run_until_shutdown()
    finally:
        polling.stop()
        sessions.close()


def make_server(host: str, port: int, application: Application, sessions: Sessions,
                token: str) -> BaseServer:
    """
    Return a running server; port 0 is any free one.

    :raises OptionError: if the address is not available.
    """
    try:
        sockets, port = bind_sockets(host, port)
    except OSError as problem:
        in_use = problem.errno in (errno.EADDRINUSE, errno.EACCES)
        reason = f'port {port} is in use' if in_use else \
            f'cannot serve on {host}: {(problem.strerror or "unknown").lower()}'
        raise OptionError(f'{reason}: choose another with --port, or 0 for any free port'
                          ) from problem
    guarded = TokenApplication(
        {'/': application}, token, extra_websocket_origins=websocket_origins(host, port),
        extra_patterns=[('/upload', UploadHandler, {'sessions': sessions})],
        unused_session_lifetime_milliseconds=_UNUSED_MS,
        check_unused_sessions_milliseconds=5000)
    http = HTTPServer(guarded)
    http.add_sockets(sockets)
    server = BaseServer(IOLoop.current(), guarded, http)
    server.start()
    return server


def _argument(document: Document, name: str) -> str:
    """Return an argument in the URL of the page."""
    context = document.session_context
    arguments = context.request.arguments if context is not None and context.request else {}
    return b''.join(arguments.get(name, [])).decode('ascii', 'replace')


@contextmanager
def _redirection(address: str) -> Iterator[Path]:
    """Yield a page for the browser, whose command line other users can see without the token."""
    with tempfile.TemporaryDirectory(prefix='gravity_comp') as name:
        page = Path(name) / 'workbench.html'
        page.write_text(f'<meta http-equiv="refresh" content="0; url={address}">')
        yield page
