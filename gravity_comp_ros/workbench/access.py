"""
Access to the server of the workbench: a token in the address, headers, and uploads.

Every user of this machine can reach the port. Every request needs the token, which only the
terminal of the workbench shows, and only pages of this server may change anything.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hmac import compare_digest
from pathlib import Path
import re
import secrets
from typing import BinaryIO
import urllib.parse

from gravity_comp_ros.workbench.page import Page
from gravity_comp_ros.workbench.session import upload_folder
from tornado.web import RequestHandler, stream_request_body

_HEADERS = {'X-Content-Type-Options': 'nosniff', 'X-Frame-Options': 'SAMEORIGIN',
            'Referrer-Policy': 'no-referrer', 'Cross-Origin-Resource-Policy': 'same-origin',
            'Cross-Origin-Opener-Policy': 'same-origin', 'Cache-Control': 'no-store',
            'Content-Security-Policy': "frame-ancestors 'self'"}


class Handler(RequestHandler):
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
            self.refuse(403, 'only this page may upload a recording or change a session')

    def refuse(self, status: int, reason: str) -> None:
        """End the request with a line of text."""
        self.set_status(status)
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(reason)


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
class UploadHandler(Handler):
    """Receives a file: PUT /upload?token=TOKEN&name=FILE."""

    _file: BinaryIO | None = None

    def prepare(self) -> None:
        """Refuse invalid uploads before any data is read."""
        super().prepare()
        if self._finished:
            return
        name = safe_name(self.get_query_argument('name', ''))
        size = self.request.headers.get('Content-Length', '')
        if self.page.session.read is None:
            self.refuse(409, 'wait until the recordings have been read')
        elif name is None:
            self.refuse(415, 'upload one file that ends in .mcap or .db3')
        elif not size.isdecimal() or int(size) > MAX_BYTES:
            self.refuse(413, f'the file is larger than {MAX_BYTES >> 30} GiB: name it on the '
                        f'command line of the workbench')
        else:
            folder = upload_folder()
            kept = sum(path.stat().st_size for path in folder.glob('*'))
            if kept + int(size) > MAX_TOTAL:
                self.refuse(507, f'all uploaded recordings together would be larger than '
                            f'{MAX_TOTAL >> 30} GiB: delete some in {folder}')
                return
            # The default limit of tornado is smaller.
            self.request.connection.set_max_body_size(MAX_BYTES)  # type: ignore[union-attr]
            self._path = folder / f'{secrets.token_hex(3)}_{name}'
            with self._saving():
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                self._file = self._path.with_suffix(_PARTIAL).open('xb')

    def data_received(self, chunk: bytes) -> None:
        """Write a part of the file; refuse a file that does not start like a recording."""
        if self._file is None:
            return
        if not self._file.tell() and not chunk.startswith(_MAGIC[self._path.suffix]):
            self.refuse(415, _OTHER_FORMAT)
            return
        with self._saving():
            self._file.write(chunk)

    @contextmanager
    def _saving(self) -> Iterator[None]:
        try:
            yield
        except OSError as problem:
            self.refuse(507, f'cannot save the file: {problem.strerror}')

    def put(self) -> None:
        """Add the complete file to the recordings."""
        if self._file is None:
            return
        if not self._file.tell():
            self.refuse(415, _OTHER_FORMAT)
            return
        with self._saving():
            # A full disk may show only now.
            self._file.close()
            self._path.with_suffix(_PARTIAL).rename(self._path)
            self._file = None
            self.page.session.add_recording(self._path)
            self.set_status(204)

    def on_connection_close(self) -> None:
        """Delete an incomplete file."""
        self._drop()

    def refuse(self, status: int, reason: str) -> None:
        """End the request, and delete an incomplete file."""
        self._drop()
        super().refuse(status, reason)

    def _drop(self) -> None:
        if self._file is not None:
            with suppress(OSError):
                self._file.close()
            self._path.with_suffix(_PARTIAL).unlink(missing_ok=True)
        self._file = None
