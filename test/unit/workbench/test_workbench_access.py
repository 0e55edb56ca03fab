"""Access to the server of the workbench: token, websocket, uploads, closing connections."""

import asyncio
from dataclasses import replace
import http.client
import inspect
import logging
from pathlib import Path
import re
import threading
import urllib.parse

from bench.shared.rough_links import two_links
from bench.shared.workbench_session import InProcess, worked
from bokeh.application import Application
from bokeh.util.token import generate_jwt_token, generate_session_id
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.workbench import access, serve
from gravity_comp_ros.workbench.page import facts_html
from gravity_comp_ros.workbench.session import Sessions
from gravity_comp_ros.workbench.store import State
import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

PATIENCE = 60.0  # s
TOKEN = 'a-secret'


class Served:
    """A server in another thread."""

    def __init__(self, sessions):
        self.sessions = sessions
        ready = threading.Event()

        async def run():
            self.server = serve.make_server('127.0.0.1', 0, Application(), sessions, TOKEN)
            self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
            ready.set()
            await self._end.wait()
            self.server.stop()
            self.server._http.stop()

        self._thread = threading.Thread(target=asyncio.run, args=(run(),), daemon=True)
        self._thread.start()
        assert ready.wait(PATIENCE)
        self.host = f'127.0.0.1:{self.server.port}'

    def call(self, function):
        """Run a function in the loop of the server and return its result."""
        async def awaited():
            result = function()
            return await result if inspect.isawaitable(result) else result
        return asyncio.run_coroutine_threadsafe(awaited(), self._loop).result(PATIENCE)

    def close(self):
        self.call(self._end.set)
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()

    def token_of_page(self):
        """Return the token for the websocket in a new page."""
        return re.search(r'"token":"([^"]+)"', self.request(f'/?token={TOKEN}')[1])[1]

    def opens(self, origin, token):
        """Return whether a page of a site can open the websocket."""
        async def connect():
            request = HTTPRequest(f'ws://{self.host}/ws', headers={'Origin': origin})
            connection = await websocket_connect(request, subprotocols=['bokeh', token])
            # Bokeh closes a connection without a valid token after the handshake.
            answer = await connection.read_message()
            connection.close()
            return answer is not None

        try:
            return self.call(connect)
        except HTTPClientError:
            return False

    def request(self, path, method='GET', body=None, **headers):
        """Return status and text of the answer to a request."""
        connection = http.client.HTTPConnection(self.host, timeout=PATIENCE)
        connection.request(method, path, body,
                           {name.replace('_', '-'): text for name, text in headers.items()})
        answer = connection.getresponse()
        result = answer.status, answer.read().decode(errors='replace'), dict(answer.getheaders())
        connection.close()
        return result


@pytest.fixture
def served(tmp_path):
    """Return a server with one session that has read a recording."""
    write_bag(tmp_path / 'run.mcap', [joint_states(two_links(1))])
    sessions = Sessions(State((tmp_path / 'run.mcap',)), tmp_path / 'state', InProcess)
    worked(sessions.attach('', object()), until='LEARN')
    running = Served(sessions)
    yield running
    running.close()


def test_only_the_token_opens_the_page_and_only_a_page_the_websocket(served):
    own = f'http://{served.host}'
    for path in ('/', '/?token=', '/?token=a-secre', '/metadata', '/autoload.js', '/favicon.ico',
                 '/ws/', '/upload'):
        status, text, headers = served.request(path)
        assert status == 403 and 'open the address' in text, path
    status, text, headers = served.request(f'/?token={TOKEN}')
    assert status == 200 and headers['X-Frame-Options'] == 'DENY'
    assert headers['Referrer-Policy'] == 'no-referrer'
    assert served.request('/static/js/bokeh.min.js')[0] == 200
    assert served.request('/static/js/bokeh-mathjax.min.js')[0] == 404
    assert served.request(f'/?token={TOKEN}', 'POST')[0] == 404
    # A rebound host name is of no use without the token.
    assert served.request('/', Host='evil.example')[0] == 403
    forged = generate_jwt_token(generate_session_id())
    assert served.opens(own, served.token_of_page())
    assert not served.opens(own, forged)
    assert not served.opens('http://evil.example', served.token_of_page())


def test_uploads_are_checked_and_limited(served, monkeypatch):
    (session,) = served.sessions.open.values()
    place = f'/upload?token={TOKEN}&session={session.id}&name='
    own = {'Origin': f'http://{served.host}'}
    recording = (session.paths[0]).read_bytes()

    def put(path, body=recording, **headers):
        return served.request(path, 'PUT', body, **headers)[:2]

    kept = served.sessions.upload_folder(session.id)
    for path, headers, status in (
            (place + 'a.mcap', {}, 403),
            (place + 'a.mcap', {'Origin': 'http://evil.example'}, 403),
            (place.replace(TOKEN, 'other') + 'a.mcap', own, 403),
            (place.replace(session.id, 'f' * 16) + 'a.mcap', own, 409),
            (place + 'a.sh', own, 415)):
        assert put(path, **headers)[0] == status, path
    for body in (b'no recording', b''):
        assert put(place + 'a.mcap', body, **own) == (
            415, 'the content is not an MCAP or rosbag2 recording')
    monkeypatch.setattr(access, 'MAX_BYTES', len(recording) - 1)
    assert put(place + 'a.mcap', **own)[0] == 413
    monkeypatch.setattr(access, 'MAX_BYTES', len(recording))
    monkeypatch.setattr(access, 'MAX_TOTAL', 2 * len(recording) - 1)
    with monkeypatch.context() as patch:
        patch.setattr(Path, 'rename', lambda *_: (_ for _ in ()).throw(OSError(28, 'disk full')))
        assert put(place + 'a.mcap', **own) == (507, 'cannot save the file: disk full')
    # The name is not used as a path; the file is in the folder of its session.
    name = urllib.parse.quote('../../<img src=x> $$x$$.mcap')
    assert put(place + name, **own)[0] == 204
    (file,) = kept.iterdir()
    assert file.name[6:] == '_img_src_x_x.mcap' and file.read_bytes() == recording
    assert session.paths[1] == file
    # All uploads together are limited, and one at a time is received.
    status, text = put(place + 'b.mcap', **own)
    assert status == 507 and 'all uploaded recordings together' in text
    monkeypatch.setattr(access, 'MAX_TOTAL', 10 * len(recording))
    first = http.client.HTTPConnection(served.host, timeout=PATIENCE)
    first.putrequest('PUT', place + 'c.mcap')
    for key, value in {**own, 'Content-Length': str(len(recording))}.items():
        first.putheader(key, value)
    first.endheaders(recording[:1000])
    while not served.call(lambda: access.UploadHandler._running):
        pass
    assert put(place + 'd.mcap', **own) == (409, 'wait until the other upload has ended')
    first.close()
    while served.call(lambda: access.UploadHandler._running):
        pass
    assert [path.name for path in kept.iterdir()] == [file.name]


def test_the_facts_of_an_upload_are_on_the_page_and_the_fit_refuses_it(served, tmp_path):
    (session,) = served.sessions.open.values()
    samples = two_links(2)
    write_bag(tmp_path / 'new.mcap', [joint_states(replace(samples, tau=samples.tau * [1, 4]))])
    status, _, _ = served.request(
        f'/upload?token={TOKEN}&session={session.id}&name=new.mcap', 'PUT',
        (tmp_path / 'new.mcap').read_bytes(), Origin=f'http://{served.host}')
    worked(session)
    assert status == 204 and session.choice.runs == (0, 1) and session.stage is None
    (line,) = re.findall('refused: [^<]*', facts_html(session.read))
    assert 'new.mcap: gains disagree' in line and line.replace('refused: ', '') in session.error
    session.learn(replace(session.choice, runs=(0,)))
    worked(session, until='DIAGNOSE')
    assert not session.error and session.stage is not None


@pytest.mark.parametrize('late', [False, True])
def test_a_connection_that_closes_at_a_wrong_moment_logs_no_error(served, caplog, late):
    page = served.token_of_page()
    tornado = served.server._tornado

    async def connect():
        return await websocket_connect(f'ws://{served.host}/ws', subprotocols=['bokeh', page])

    client = served.call(connect)
    (connection,) = served.call(lambda: list(tornado._clients))
    closed, socket = threading.Event(), connection._socket
    on_close = socket.on_close

    def closing():
        try:
            on_close()
        finally:
            closed.set()

    async def arrive():
        message = connection.protocol.create('PULL-DOC-REQ')
        for fragment in (message.header_json, message.metadata_json, message.content_json):
            await socket.on_message(fragment)

    socket.on_close = closing
    with caplog.at_level(logging.ERROR):
        # Bokeh does this after a ping to a socket that is closing.
        served.call(lambda: tornado.client_lost(connection))
        if late:
            served.call(arrive)
        served.call(client.close)
        assert closed.wait(PATIENCE)
        served.call(lambda: None)
    assert [record.getMessage() for record in caplog.records
            if serve.is_of_an_open_page(record)] == []
    assert served.call(lambda: list(tornado._clients)) == []
    loggers = {record.name for record in caplog.records}
    assert loggers <= set(serve.LOGGERS), loggers
