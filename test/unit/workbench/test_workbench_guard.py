"""Connections of the workbench server that close at the wrong moment."""

import asyncio
import inspect
import logging
import threading

from bokeh.application import Application
from bokeh.client import pull_session
from bokeh.server.server import BaseServer
from gravity_comp_ros.workbench.guard import allowed_hosts, GuardedApplication
import pytest
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets

PATIENCE = 60.0  # s


@pytest.fixture
def served():
    """Yield the port, the server application, and a function that runs another in its loop."""
    ready, server = threading.Event(), {}

    async def serve():
        sockets = bind_sockets(0, '127.0.0.1')
        server['port'] = sockets[0].getsockname()[1]
        hosts = allowed_hosts('127.0.0.1', server['port'])
        server['application'] = GuardedApplication({'/': Application()}, hosts, '127.0.0.1',
                                                   extra_websocket_origins=list(hosts))
        http = HTTPServer(server['application'])
        http.add_sockets(sockets)
        base = BaseServer(IOLoop.current(), server['application'], http)
        base.start()
        server.update(loop=asyncio.get_running_loop(), end=asyncio.Event())
        ready.set()
        await server['end'].wait()
        base.stop()
        http.stop()

    async def call(function):
        result = function()
        return await result if inspect.isawaitable(result) else result

    def in_loop(function):
        return asyncio.run_coroutine_threadsafe(call(function), server['loop']).result(PATIENCE)

    thread = threading.Thread(target=asyncio.run, args=(serve(),), daemon=True)
    thread.start()
    assert ready.wait(PATIENCE)
    yield server['port'], server['application'], in_loop
    in_loop(server['end'].set)
    thread.join(PATIENCE)
    assert not thread.is_alive()


def test_a_connection_that_closes_after_a_failed_ping_is_no_error(served, caplog):
    port, application, in_loop = served
    session = pull_session(url=f'http://127.0.0.1:{port}/')
    connections = in_loop(lambda: list(application._clients))
    assert len(connections) == 1
    closed = threading.Event()
    socket = connections[0]._socket
    on_close = socket.on_close

    def watched():
        try:
            on_close()
        finally:
            closed.set()

    socket.on_close = watched
    # Bokeh does this after a ping to a socket that is closing.
    in_loop(lambda: application.client_lost(connections[0]))
    with caplog.at_level(logging.ERROR):
        session.close()
        assert closed.wait(PATIENCE)
        in_loop(lambda: None)
    assert [record.getMessage() for record in caplog.records] == []
    assert in_loop(lambda: list(application._clients)) == []


def test_messages_that_are_read_after_the_end_of_their_connection_are_dropped(served, caplog):
    port, application, in_loop = served
    session = pull_session(url=f'http://127.0.0.1:{port}/')
    connection, = in_loop(lambda: list(application._clients))
    message = connection.protocol.create('PULL-DOC-REQ')

    async def arrive():
        for fragment in (message.header_json, message.metadata_json, message.content_json):
            await connection._socket.on_message(fragment)

    with caplog.at_level(logging.ERROR):
        in_loop(arrive)
        in_loop(lambda: application.client_lost(connection))
        in_loop(arrive)
        session.close()
    assert [record.getMessage() for record in caplog.records] == []
