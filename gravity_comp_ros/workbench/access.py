"""
Access control of the server: a token in the URL, response headers, and uploads.

Every user of this machine can reach the port. The page, its uploads and its list of sessions
require the token, which only the terminal of the workbench shows. The websocket accepts only
session ids that the server has signed and put into a page.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hmac import compare_digest
from ipaddress import ip_address
from pathlib import Path
import re
import secrets
from typing import Any, BinaryIO
import urllib.parse

from bokeh.server.tornado import BokehTornado
from gravity_comp_ros.workbench.session import Sessions
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.web import OutputTransform, RequestHandler, stream_request_body

ARGUMENT = 'token'
# MathJax would turn formulas in names into links.
_REFUSED = '/static/js/bokeh-mathjax'
_HEADERS = {'X-Content-Type-Options': 'nosniff', 'X-Frame-Options': 'DENY',
            'Referrer-Policy': 'no-referrer', 'Cross-Origin-Resource-Policy': 'same-origin',
            'Cross-Origin-Opener-Policy': 'same-origin',
            'Content-Security-Policy': "frame-ancestors 'none'"}


def websocket_origins(address: str, port: int) -> list[str]:
    """Return the hosts of pages that may open the websocket of a server on this address."""
    try:
        is_everywhere = ip_address(address).is_unspecified
    except ValueError:
        is_everywhere = not address
    if is_everywhere:
        return ['*']
    own = f'[{address}]' if ':' in address else address
    return [f'{name}:{port}' for name in ('localhost', '127.0.0.1', '[::1]', own)]


class TokenApplication(BokehTornado):
    """Bokeh's server application, restricted to requests with the token."""

    def __init__(self, applications: Any, token: str, **more: Any) -> None:
        self._token = token
        super().__init__(applications, sign_sessions=True,
                         secret_key=secrets.token_bytes(32), **more)
        self.add_transform(_Headers)

    def find_handler(self, request: HTTPServerRequest, **more: Any) -> Any:
        """Return the handler of a request, or a refusal without the token."""
        if request.path.startswith(_REFUSED) or request.method not in ('GET', 'HEAD', 'PUT'):
            return self._refusal(request, 404, 'there is no such page')
        # Bokeh's scripts are public, and the websocket has its own check.
        is_open = request.path.startswith('/static/') or request.path == '/ws'
        given = b''.join(request.arguments.get(ARGUMENT, []))
        if not is_open and not compare_digest(given, self._token.encode()):
            return self._refusal(request, 403, 'open the address that the terminal of the '
                                 'workbench shows: it contains a token')
        return super().find_handler(request, **more)

    def _refusal(self, request: HTTPServerRequest, status: int, reason: str) -> Any:
        return self.get_handler_delegate(request, _Refusal, {'status': status, 'reason': reason})


class _Refusal(RequestHandler):
    """Refuses a request with a line of text."""

    def initialize(self, status: int, reason: str) -> None:
        """Store status and reason."""
        self._status, self._text = status, reason

    def prepare(self) -> None:
        """Refuse."""
        self.set_status(self._status)
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(self._text + '\n')


class _Headers(OutputTransform):
    """Adds the headers that keep other sites from framing or including a page."""

    def transform_first_chunk(self, status_code: int, headers: HTTPHeaders, chunk: bytes,
                              finishing: bool) -> tuple[int, HTTPHeaders, bytes]:
        """Return the response with the headers."""
        for name, value in _HEADERS.items():
            headers[name] = value
        return status_code, headers, chunk


# Maximum size in bytes of a recording, and of all uploaded recordings that are kept.
MAX_BYTES, MAX_TOTAL = 2 * 2 ** 30, 16 * 2 ** 30
_MAGIC = {'.mcap': b'\x89MCAP0\r\n', '.db3': b'SQLite format 3\x00'}
_MAX_NAME = 60
_PARTIAL = '.partial'
_OTHER_FORMAT = 'the content is not an MCAP or rosbag2 recording'


def safe_name(name: str) -> str | None:
    """Return a safe file name for the browser's name of a recording; None for another suffix."""
    stem, suffix = Path(name.replace('\\', '/')).stem, Path(name).suffix.lower()
    if suffix not in _MAGIC:
        return None
    safe = re.sub(r'[^A-Za-z0-9_-]+', '_', stem).strip('_')[:_MAX_NAME]
    return f'{safe or "recording"}{suffix}'


@stream_request_body
class UploadHandler(RequestHandler):
    """
    Receives a file for a session with an open page: PUT /upload?token=TOKEN&session=ID&name=FILE.

    Only pages of this server may upload: the browser's `Origin` header must name this server.
    """

    _running: UploadHandler | None = None
    _file: BinaryIO | None

    def initialize(self, sessions: Sessions) -> None:
        """Store the sessions."""
        self._sessions, self._file = sessions, None

    def prepare(self) -> None:
        """Refuse invalid uploads before any data is read."""
        origin = urllib.parse.urlsplit(self.request.headers.get('Origin', '')).netloc
        name = safe_name(self.get_query_argument('name', ''))
        session = self._sessions.open.get(self.get_query_argument('session', ''))
        size = self.request.headers.get('Content-Length', '')
        if self.request.method != 'PUT' or origin != self.request.host:
            self._refuse(403, 'only this page may upload a recording')
        elif session is None or session.page is None or session.read is None:
            self._refuse(409, 'wait until the recordings have been read')
        elif UploadHandler._running is not None:
            self._refuse(409, 'wait until the other upload has ended')
        elif name is None:
            self._refuse(415, 'upload one file that ends in .mcap or .db3')
        elif not size.isdecimal() or int(size) > MAX_BYTES:
            self._refuse(413, f'the file is larger than {MAX_BYTES >> 30} GiB: name it on the '
                         f'command line of the workbench')
        else:
            folder = self._sessions.upload_folder(session.id)
            kept = sum(path.stat().st_size for path in folder.parent.rglob('*') if path.is_file())
            if kept + int(size) > MAX_TOTAL:
                self._refuse(507, f'all uploaded recordings together would be larger than '
                             f'{MAX_TOTAL >> 30} GiB: delete some in {folder.parent}')
                return
            # The default limit of tornado is smaller.
            self.request.connection.set_max_body_size(MAX_BYTES)  # type: ignore[union-attr]
            self._session, self._path = session, folder / f'{secrets.token_hex(3)}_{name}'
            with self._saving():
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                self._file = self._path.with_suffix(_PARTIAL).open('xb')
                UploadHandler._running = self

    def data_received(self, chunk: bytes) -> None:
        """Write a part of the file; refuse a file that does not start like a recording."""
        if self._file is None:
            return
        if not self._file.tell() and not chunk.startswith(_MAGIC[self._path.suffix]):
            self._refuse(415, _OTHER_FORMAT)
            return
        with self._saving():
            self._file.write(chunk)

    @contextmanager
    def _saving(self) -> Iterator[None]:
        try:
            yield
        except OSError as problem:
            self._refuse(507, f'cannot save the file: {problem.strerror}')

    def put(self) -> None:
        """Add the complete file to the session."""
        if self._file is None:
            return
        if not self._file.tell():
            self._refuse(415, _OTHER_FORMAT)
            return
        with self._saving():
            # A full disk may show only now.
            self._file.close()
            self._path.with_suffix(_PARTIAL).rename(self._path)
            self._file = UploadHandler._running = None
            self._session.add_recording(self._path)
            self.set_status(204)

    def on_connection_close(self) -> None:
        """Delete an incomplete file."""
        self._drop()

    def _refuse(self, status: int, reason: str) -> None:
        self._drop()
        self.set_status(status)
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(reason)

    def _drop(self) -> None:
        if self._file is not None:
            UploadHandler._running = None
            with suppress(OSError):
                self._file.close()
            self._path.with_suffix(_PARTIAL).unlink(missing_ok=True)
        self._file = None


SCRIPT = """
const status = document.getElementById('upload-status')
const upload = async (files) => {
  if (files.length != 1) {
    status.textContent = 'One file at a time.'
    return
  }
  const file = files[0], url = new URL('upload' + location.search, location)
  url.searchParams.set('name', file.name)
  status.textContent = `uploading ${file.name} …`
  const answer = file.size > MAX_BYTES ? null :
    await fetch(url, {method: 'PUT', body: file}).catch(() => null)
  status.textContent = !answer ? `${file.name} was not uploaded: it is a folder or too large.`
    : answer.ok ? `${file.name} was uploaded.` : `${file.name}: ${await answer.text()}`
}
document.getElementById('upload').addEventListener('change', (event) => upload(event.target.files))
for (const type of ['dragover', 'drop'])
  document.addEventListener(type, (event) => {
    event.preventDefault()
    if (type == 'drop' && event.dataTransfer.files.length) upload(event.dataTransfer.files)
  })
""".replace('MAX_BYTES', str(MAX_BYTES))
