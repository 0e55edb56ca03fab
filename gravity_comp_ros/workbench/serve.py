"""Serve the page to this machine."""

from __future__ import annotations

from dataclasses import dataclass, replace
import errno
from pathlib import Path
import signal
import socket
import sys
from types import FrameType

from bokeh.application import Application
from bokeh.application.application import SessionContext
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import Server
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.workbench.jobs import Read
from gravity_comp_ros.workbench.live_view import Follower
from gravity_comp_ros.workbench.page import Page
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.worker import Worker

Models = tuple[tuple[str, GravityModel], ...]

_LOCAL = ('127.0.0.1', 'localhost')


@dataclass(frozen=True)
class ServeOptions:
    """What to show and where; see `gravity_comp workbench --help`."""

    bags: tuple[Path, ...]
    models: tuple[Path, ...] = ()
    reading: ReadOptions = ReadOptions()
    formulation: str = 'potential'
    live: str | None = None
    host: str = '127.0.0.1'
    port: int = 5006
    browser: bool = True


def serve(options: ServeOptions) -> None:
    """
    Serve until interrupted.

    :raises OptionError: if the address cannot be served on.
    :raises ModelFileError: if a model cannot be read.
    """
    models = tuple((path.name, load_model(path)) for path in options.models)
    follower = _follower(options.live)
    # The first page finds a process that is warm already.
    spare = [Worker()] if options.bags else []

    def start(document: Document) -> None:
        model = models[0][0] if models and options.reading.joints is None else ''
        read = Read(options.bags, _reading(options, models), model) if options.bags else None
        worker = spare.pop() if spare else Worker()
        page = Page(document, Session(options.bags, options.formulation, models), worker, read,
                    follower)

        def ended(context: SessionContext) -> None:
            page.close()

        document.on_session_destroyed(ended)

    server = _server(options, Application(FunctionHandler(start)))
    address = f'http://{options.host if options.host in _LOCAL else "127.0.0.1"}:{server.port}/'
    print(f'workbench at {address} (Ctrl-C ends it)', flush=True)
    if options.host not in _LOCAL:
        print(f'warning: served on {options.host}: whoever reaches this machine can use it',
              file=sys.stderr, flush=True)
    if options.browser:
        server.io_loop.add_callback(server.show, '/')
    for stop in (signal.SIGINT, signal.SIGTERM):
        signal.signal(stop, _interrupt)
    try:
        server.run_until_shutdown()
    except KeyboardInterrupt:
        pass
    finally:
        for worker in spare:
            worker.close()
        if follower is not None:
            follower.close()


def _server(options: ServeOptions, application: Application) -> Server:
    try:
        port = options.port or _free_port(options.host)
        # Pages of other sites may not talk to this one.
        origins = [f'{name}:{port}' for name in (*_LOCAL, options.host)]
        server = Server({'/': application}, address=options.host, port=port,
                        allow_websocket_origin=origins,
                        unused_session_lifetime_milliseconds=60000,
                        check_unused_sessions_milliseconds=5000)
    except OSError as problem:
        taken = problem.errno in (errno.EADDRINUSE, errno.EACCES)
        what = f'port {options.port} is taken' if taken else \
            f'cannot serve on {options.host}: {(problem.strerror or "unknown").lower()}'
        raise OptionError(f'{what}: choose another with --port, or 0 for any that is free'
                          ) from problem
    server.start()
    return server


def _free_port(host: str) -> int:
    with socket.create_server((host, 0)) as probe:
        return int(probe.getsockname()[1])


def _reading(options: ServeOptions, models: Models) -> ReadOptions:
    """Return what to read: a given model says which joints there are."""
    if not models or options.reading.joints is not None:
        return options.reading
    return replace(options.reading, joints=models[0][1].joints)


def _follower(node: str | None) -> Follower | None:
    if node is None:
        return None
    # The only way from here to ROS; whoever has no --live needs none.
    from gravity_comp_ros.node.node_client import follow
    return follow(node)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
