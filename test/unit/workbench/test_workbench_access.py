"""Access to the server of the workbench: token and requests."""

import asyncio
from dataclasses import replace
import http.client
import inspect
import json
import re
import threading
import time
import urllib.parse

from bench.shared.rough_links import two_links
from bench.shared.workbench_session import session_of, worked
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.workbench import serve
from gravity_comp_ros.workbench.page import facts_html, Page
import pytest

PATIENCE = 60.0  # s
TOKEN = 'a-secret'


class Served:
    """A server in another thread."""

    def __init__(self, session):
        self.session = session
        ready = threading.Event()

        async def run():
            server, port = serve.make_server('127.0.0.1', 0, Page(session), TOKEN)
            self.host = f'127.0.0.1:{port}'
            self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
            ready.set()
            await self._end.wait()
            server.stop()

        self._thread = threading.Thread(target=asyncio.run, args=(run(),), daemon=True)
        self._thread.start()
        assert ready.wait(PATIENCE)

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
    """Return a server that has read a recording."""
    write_bag(tmp_path / 'run.mcap', [joint_states(two_links(1))])
    running = Served(worked(session_of(tmp_path / 'run.mcap'), until='LEARN'))
    yield running
    running.close()


def test_only_the_token_opens_the_page_and_only_a_page_changes_a_session(served, monkeypatch):
    monkeypatch.setattr(serve, '_MAX_WAIT', 0.5)
    session, own, rest = served.session, f'http://{served.host}', f'?token={TOKEN}'
    for path in ('/', '/?token=', '/?token=a-secre', '/shown', '/act', '/view', '/file/arm.json'):
        status, text, headers = served.request(path)
        assert status == 403 and 'open the address' in text, path
    status, text, headers = served.request(f'/{rest}')
    assert status == 200 and headers['X-Frame-Options'] == 'SAMEORIGIN'
    assert headers['Referrer-Policy'] == 'no-referrer'
    assert "script-src 'nonce-" in text
    # A host name is of no use without the token.
    assert served.request('/', Host='evil.example')[0] == 403
    state = json.loads(served.request(f'/shown{rest}')[1])
    assert '<h1>' in state['verdict'] and 'run.mcap' in state['settings']
    # The same page again is sent only when it changes, or after a while.
    again = f'/shown{rest}&{urllib.parse.urlencode({"tag": state["tag"]})}'
    began = time.monotonic()
    assert json.loads(served.request(again)[1])['tag'] == state['tag']
    assert time.monotonic() - began >= 0.5
    body = json.dumps({'what': 'cancel', 'value': '', 'form': []})
    for headers in ({}, {'Origin': 'http://evil.example'}):
        assert served.request(f'/act{rest}', 'POST', body, **headers)[0] == 403
    for wrong in ('', '{}', body.replace('cancel', 'delete')):
        assert served.request(f'/act{rest}', 'POST', wrong, Origin=own)[0] == 400
    assert session.worker.job is not None
    assert served.request(f'/act{rest}', 'POST', body, Origin=own)[0] == 200
    assert session.worker.job is None and 'cancelled' in session.error


def test_the_facts_of_an_added_recording_are_on_the_page_and_the_fit_refuses_it(served, tmp_path):
    session = served.session
    samples = two_links(2)
    write_bag(tmp_path / 'new.mcap', [joint_states(replace(samples, tau=samples.tau * [1, 4]))])
    Page(session).act('record', '', {'recording': [str(tmp_path / 'new.mcap')]})
    worked(session)
    assert session.choice.runs == (0, 1) and session.stage is None
    (line,) = re.findall('refused: [^<]*', facts_html(session.read))
    assert 'new.mcap: gains disagree' in line and line.replace('refused: ', '') in session.error
    session.learn(replace(session.choice, runs=(0,)))
    worked(session, until='DIAGNOSE')
    assert not session.error and session.stage is not None
