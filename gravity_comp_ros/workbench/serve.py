"""Server of the workbench page."""

from __future__ import annotations

from dataclasses import dataclass, field
import errno
import logging
from pathlib import Path
import secrets
import signal
import socket
import sys
import traceback
import warnings

from bokeh.application import Application
from bokeh.application.application import SessionContext
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.util import bind_sockets
from bokeh.util.warnings import BokehUserWarning
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.workbench import store
from gravity_comp_ros.workbench.choice import Choice
from gravity_comp_ros.workbench.guard import allowed_hosts, GuardedApplication
from gravity_comp_ros.workbench.page import Page
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.session_state import GivenModel
from gravity_comp_ros.workbench.sessions import Sessions
from gravity_comp_ros.workbench.upload import UploadHandler
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop, PeriodicCallback

_LOCAL = ('127.0.0.1', 'localhost')
_POLL_MS = 100
# Time, in ms, after which a closed page is discarded; its session remains.
_UNUSED_MS = 15000


@dataclass(frozen=True)
class ServeOptions:
    """Options of `gravity_comp workbench`."""

    bags: tuple[Path, ...]
    models: tuple[Path, ...] = ()
    reading: ReadOptions = ReadOptions()
    formulation: str | None = None
    host: str = '127.0.0.1'
    port: int = 5006
    browser: bool = True
    max_speed: float | None = None
    all_samples: bool = False
    place: Path | None = field(default_factory=store.folder)
    urdf: Path | None = None


def is_of_an_open_page(record: logging.LogRecord) -> bool:
    """
    Return whether to show a log record of Bokeh.

    A message of a page may be handled after the page was closed. Bokeh then misses the session
    of the page and logs a traceback, which is suppressed.
    """
    error = record.exc_info[1] if record.exc_info else None
    if not isinstance(error, AssertionError):
        return True
    frames = traceback.extract_tb(error.__traceback__)
    return not (frames and frames[-1].name == 'session')


def serve(options: ServeOptions) -> None:
    """
    Serve until interrupted.

    :raises OptionError: if the address is not available.
    :raises ModelFileError: if a model cannot be read.
    """
    # A browser returns a model that it has just received; this is harmless.
    warnings.filterwarnings('ignore', 'reference already known', BokehUserWarning)
    # A page may be closed while a message is sent to it.
    logging.getLogger('bokeh.server.views.ws').setLevel(logging.ERROR)
    logging.getLogger('bokeh.server.protocol_handler').addFilter(is_of_an_open_page)
    given = tuple(GivenModel(path, load_model(path)) for path in options.models)
    sessions = Sessions(lambda: _session(options, given), options.place, warm=True)

    def start(document: Document) -> None:
        identity = _requested_session(document)
        page = Page(document, sessions, identity, secrets.token_urlsafe(16))

        def ended(context: SessionContext) -> None:
            page.close()

        document.on_session_destroyed(ended)

    server = _server(options, Application(FunctionHandler(start)), sessions)
    polling = PeriodicCallback(sessions.poll, _POLL_MS)
    polling.start()
    # The loop handles the signal between callbacks, so no callback is interrupted.
    server.io_loop.asyncio_loop.add_signal_handler(  # type: ignore[attr-defined]
        signal.SIGINT, server.io_loop.stop)
    address = f'http://{options.host if options.host in _LOCAL else "127.0.0.1"}:{server.port}/'
    print(f'workbench at {address} (Ctrl-C to stop)', flush=True)
    if options.host not in _LOCAL:
        print(f'warning: served on {options.host}: anyone who can reach this machine can use it',
              file=sys.stderr, flush=True)
    if options.browser:
        server.io_loop.add_callback(server.show, '/')
    try:
        server.run_until_shutdown()
    finally:
        polling.stop()
        sessions.close()


def _session(options: ServeOptions, given: tuple[GivenModel, ...]) -> Session:
    reading = options.reading
    urdf = None if options.urdf is None else options.urdf.resolve()
    # The same default as `fit`: a chain with --urdf.
    default = FitOptions().formulation if urdf is None else 'chain'
    choice = Choice((), reading.joints or (), options.formulation or default,
                    dict(reading.effort_scale), reading.differentiate, options.max_speed,
                    options.all_samples, None if urdf is None else str(urdf))
    return Session(options.bags, choice, given, reading.topic, urdf)


def _requested_session(document: Document) -> str:
    """Return the session id in the URL of the page."""
    context = document.session_context
    arguments = context.request.arguments if context is not None and context.request else {}
    return b''.join(arguments.get('session', [b''])).decode('ascii', 'replace')


def _server(options: ServeOptions, application: Application,
            sessions: Sessions) -> BaseServer:
    try:
        port = options.port or _free_port(options.host)
        sockets, port = bind_sockets(options.host, port)
    except OSError as problem:
        in_use = problem.errno in (errno.EADDRINUSE, errno.EACCES)
        reason = f'port {options.port} is in use' if in_use else \
            f'cannot serve on {options.host}: {(problem.strerror or "unknown").lower()}'
        raise OptionError(f'{reason}: choose another with --port, or 0 for any free port'
                          ) from problem
    hosts = allowed_hosts(options.host, port)
    # Refuses websockets from pages of other sites and requests with other host names.
    guarded = GuardedApplication(
        {'/': application}, hosts, options.host, extra_websocket_origins=list(hosts),
        extra_patterns=[('/upload', UploadHandler, {'sessions': sessions})],
        unused_session_lifetime_milliseconds=_UNUSED_MS,
        check_unused_sessions_milliseconds=5000)
    http = HTTPServer(guarded)
    http.add_sockets(sockets)
    server = BaseServer(IOLoop.current(), guarded, http)
    server.start()
    return server


def _free_port(host: str) -> int:
    with socket.create_server((host, 0)) as probe:
        return int(probe.getsockname()[1])
