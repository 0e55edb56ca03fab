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
        found = self.open.get(identity) or self._saved(identity) or self._new()
        found.page = page
        self._close_oldest()
        found.start()
        return found

    def detach(self, page: object) -> None:
        """Detach a closed page; its running job continues."""
        for one in self.open.values():
            if one.page is page:
                one.page, one.detached_at = None, time.monotonic()

    def upload_folder(self, identity: str) -> Path:
        """Return the folder of the uploaded recordings of a session."""
        if self.place is not None:
            return self.place / 'recordings' / identity
        if self._temporary is None:
            self._temporary = TemporaryDirectory(prefix='gravity_comp')
        return Path(self._temporary.name) / identity

    def poll(self) -> None:
        """Process the events of all workers, and end idle processes without a page."""
        for one in list(self.open.values()):
            one.poll()
            timed_out = one.page is None and time.monotonic() - one.detached_at > _IDLE_TIMEOUT
            if timed_out and not one.worker.busy:
                one.worker.rest()

    def earlier(self, own: str = '') -> list[store.SavedSession]:
        """Return the saved sessions, the newest first."""
        if self.place is None:
            return []
        return [saved for saved in store.listed(self.place) if saved.id != own]

    def close(self) -> None:
        """Close all workers."""
        for worker in [*self._spare, *(one.worker for one in self.open.values())]:
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
            found = self._new()
            found.warning = str(problem)
            return found
        found = self._opened(identity, session)
        found.hashes = hashes
        return found

    def _opened(self, identity: str, session: Session) -> OpenSession:
        worker = self._spare.pop() if self._spare else None
        found = OpenSession(identity, session, self.place, self._may_start, worker)
        self.open[identity] = found
        return found

    def _may_start(self, asking: OpenSession) -> bool:
        """Return whether another process may start; idle processes of others are ended for it."""
        others = [one for one in self.open.values() if one is not asking and one.worker.alive]
        idle = [one for one in others if not one.worker.busy]
        for one in sorted(idle, key=lambda one: one.page is not None):
            if len(others) < self._max_processes:
                break
            one.worker.rest()
            others.remove(one)
        return len(others) < self._max_processes

    def _close_oldest(self) -> None:
        """Close the oldest sessions without a page; they remain saved on disk."""
        detached = sorted((one for one in self.open.values()
                           if one.page is None and not one.worker.busy),
                          key=lambda one: one.detached_at)
        for one in detached[:max(len(self.open) - _MAX_OPEN, 0)]:
            one.close()
            del self.open[one.id]
