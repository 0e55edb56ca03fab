"""All sessions of one server, with a limited number of worker processes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import secrets
from tempfile import TemporaryDirectory
import time

from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.workbench import store
from gravity_comp_ros.workbench.open_session import OpenSession
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.worker import Worker

# Each worker process uses at least 80 MB.
MAX_PROCESSES = 4
_MAX_OPEN = 8
# Time, in s, after which the process of a session without a page ends.
_IDLE_TIMEOUT = 60.0


class Sessions:
    """
    The open sessions. A session belongs to one page at a time, the most recent one.

    :param fresh: creates a new session.
    :param place: folder of saved sessions; None to save none.
    """

    def __init__(self, fresh: Callable[[], Session], place: Path | None,
                 max_processes: int = MAX_PROCESSES, warm: bool = False) -> None:
        self._fresh, self.place, self._max_processes = fresh, place, max_processes
        self.open: dict[str, OpenSession] = {}
        self._temporary: TemporaryDirectory[str] | None = None
        # The first page uses a process that was started in advance.
        self._spare: list[Worker] = [Worker(warm=True)] if warm else []

    def attach(self, identity: str, page: object) -> OpenSession:
        """Return the session with this id for a page, or a new one if there is none."""
        opened = self.open.get(identity) or self._saved(identity) or self._new()
        opened.page = page
        self._close_oldest()
        opened.start()
        return opened

    def detach(self, page: object) -> None:
        """Detach a closed page; its running job continues."""
        for opened in self.open.values():
            if opened.page is page:
                opened.page, opened.detached_at = None, time.monotonic()

    def upload_folder(self, identity: str) -> Path:
        """Return the folder of the uploaded recordings of a session."""
        if self.place is not None:
            return self.place / 'recordings' / identity
        if self._temporary is None:
            self._temporary = TemporaryDirectory(prefix='gravity_comp')
        return Path(self._temporary.name) / identity

    def poll(self) -> None:
        """Process the events of all workers, and end idle processes without a page."""
        for opened in list(self.open.values()):
            opened.poll()
            idle = time.monotonic() - opened.detached_at
            if opened.page is None and idle > _IDLE_TIMEOUT and not opened.worker.busy:
                opened.worker.rest()

    def earlier(self, own: str = '') -> list[store.SavedSession]:
        """Return the saved sessions, the newest first."""
        if self.place is None:
            return []
        return [saved for saved in store.listed(self.place) if saved.id != own]

    def close(self) -> None:
        """Close all workers."""
        for worker in [*self._spare, *(opened.worker for opened in self.open.values())]:
            worker.close()
        if self._temporary is not None:
            self._temporary.cleanup()

    def _new(self) -> OpenSession:
        return self._opened(secrets.token_hex(8), self._fresh())

    def _saved(self, identity: str) -> OpenSession | None:
        if self.place is None or not store.is_id(identity):
            return None
        try:
            session, hashes = store.load(self.place, identity)
        except GravityCompError as problem:
            opened = self._new()
            opened.warning = str(problem)
            return opened
        opened = self._opened(identity, session)
        opened.hashes = hashes
        return opened

    def _opened(self, identity: str, session: Session) -> OpenSession:
        worker = self._spare.pop() if self._spare else None
        opened = OpenSession(identity, session, self.place, self._may_start, worker)
        self.open[identity] = opened
        return opened

    def _may_start(self, asking: OpenSession) -> bool:
        """Return whether another process may start; idle processes of others are ended for it."""
        others = [opened for opened in self.open.values()
                  if opened is not asking and opened.worker.alive]
        idle = [opened for opened in others if not opened.worker.busy]
        for opened in sorted(idle, key=lambda opened: opened.page is not None):
            if len(others) < self._max_processes:
                break
            opened.worker.rest()
            others.remove(opened)
        return len(others) < self._max_processes

    def _close_oldest(self) -> None:
        """Close the oldest sessions without a page; they remain saved on disk."""
        detached = sorted((opened for opened in self.open.values()
                           if opened.page is None and not opened.worker.busy),
                          key=lambda opened: opened.detached_at)
        for opened in detached[:max(len(self.open) - _MAX_OPEN, 0)]:
            opened.close()
            del self.open[opened.id]
