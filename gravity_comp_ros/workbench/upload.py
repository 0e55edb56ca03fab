"""Recordings that a browser brings: one file at a time, streamed to disk, its size bounded."""

from __future__ import annotations

from pathlib import Path
import re
import secrets
from typing import Any
import urllib.parse

from gravity_comp_ros.workbench.sessions import Sessions
from tornado.web import RequestHandler, stream_request_body

MOST_BYTES = 2 * 2 ** 30
_BEGINNINGS = {'.mcap': b'\x89MCAP0\r\n', '.db3': b'SQLite format 3\x00'}
_LONGEST = 60
_PARTIAL = '.partial'
_OTHER = 'the file is no MCAP or rosbag2 recording, whatever its name'


def safe_name(name: str) -> str | None:
    """Return a plain file name for what a browser calls a recording; None for another kind."""
    stem, kind = Path(name.replace('\\', '/')).stem, Path(name).suffix.lower()
    if kind not in _BEGINNINGS:
        return None
    plain = re.sub(r'[^A-Za-z0-9_-]+', '_', stem).strip('_')[:_LONGEST]
    return f'{plain or "recording"}{kind}'


@stream_request_body
class UploadHandler(RequestHandler):
    """
    Takes a file for a session that is open in a page: PUT /bring?session=ID&name=FILE.

    Only pages of this server may: a browser says in `Origin` whose page asks.
    """

    def initialize(self, sessions: Sessions) -> None:
        """Keep the sessions."""
        self._sessions, self._begun, self._size = sessions, b'', 0
        self._path: Path | None = None
        self._file: Any = None

    def prepare(self) -> None:
        """Refuse what cannot be taken before any of it is read."""
        origin = urllib.parse.urlsplit(self.request.headers.get('Origin', '')).netloc
        name = safe_name(self.get_query_argument('name', ''))
        one = self._sessions.open.get(self.get_query_argument('session', ''))
        size = self.request.headers.get('Content-Length', '')
        if self.request.method != 'PUT' or origin != self.request.host:
            self._refuse(403, 'only this page may bring a recording')
        elif one is None or one.page is None or one.session.read is None:
            self._refuse(409, 'wait until the recordings are read')
        elif name is None:
            self._refuse(415, 'bring one file that ends in .mcap or .db3')
        elif not size.isdecimal() or int(size) > MOST_BYTES:
            self._refuse(413, f'the file is larger than {MOST_BYTES >> 30} GiB: name it when the '
                         f'workbench is started')
        else:
            self._one = one
            # tornado's own limit is smaller.
            self.request.connection.set_max_body_size(MOST_BYTES)  # type: ignore[union-attr]
            folder = self._sessions.brought(one.id)
            self._path = folder / f'{secrets.token_hex(3)}_{name}'
            try:
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                self._file = self._path.with_suffix(_PARTIAL).open('xb')
            except OSError as problem:
                self._refuse(507, f'cannot keep the file: {problem.strerror}')

    def data_received(self, chunk: bytes) -> None:
        """Write a part of the file, if it is a recording at all."""
        if self._file is None or self._path is None:
            return
        wanted = _BEGINNINGS[self._path.suffix]
        if len(self._begun) < len(wanted):
            self._begun += chunk[:len(wanted) - len(self._begun)]
            if not wanted.startswith(self._begun):
                self._refuse(415, _OTHER)
                return
        try:
            self._file.write(chunk)
        except OSError as problem:
            self._refuse(507, f'cannot keep the file: {problem.strerror}')

    def put(self) -> None:
        """Give the whole file to the session."""
        if self._file is None or self._path is None:
            return
        if self._begun != _BEGINNINGS[self._path.suffix]:
            self._refuse(415, _OTHER)  # empty, or hardly begun
            return
        self._file.close()
        self._path.with_suffix(_PARTIAL).rename(self._path)
        self._file = None
        self._one.bring(self._path)
        self.set_status(204)

    def on_connection_close(self) -> None:
        """Leave nothing of a file that came in part."""
        self._drop()

    def _refuse(self, status: int, words: str) -> None:
        self._drop()
        self.set_status(status)
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(words)

    def _drop(self) -> None:
        if self._file is not None and self._path is not None:
            self._file.close()
            self._path.with_suffix(_PARTIAL).unlink(missing_ok=True)
        self._file = None


SCRIPT = """
const words = document.getElementById('bring-words')
const bring = async (files) => {
  if (files.length != 1) {
    words.textContent = 'One file at a time.'
    return
  }
  const file = files[0], session = new URL(location.href).searchParams.get('session') || ''
  words.textContent = `${file.name} is being brought …`
  const place = `bring?session=${session}&name=${encodeURIComponent(file.name)}`
  const answer = file.size > MOST ? null :
    await fetch(place, {method: 'PUT', body: file}).catch(() => null)
  words.textContent = !answer ? `${file.name} could not be brought: is it a folder, or too large?`
    : answer.ok ? `${file.name} was brought.` : `${file.name}: ${await answer.text()}`
}
document.getElementById('bring').addEventListener('change', (event) => bring(event.target.files))
for (const what of ['dragover', 'drop'])
  document.addEventListener(what, (event) => {
    event.preventDefault()
    if (what == 'drop' && event.dataTransfer.files.length) bring(event.dataTransfer.files)
  })
""".replace('MOST', str(MOST_BYTES))
