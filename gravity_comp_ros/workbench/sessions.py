"""All sessions of one server: found again by their name, and only so many at work."""

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

# Each process that works has 80 MB and more.
MOST_PROCESSES = 4
_MOST_OPEN = 8
# A session that nobody looks at gives its process back after so many seconds.
_PATIENCE = 60.0


class Sessions:
    """
    The sessions that are open. A session belongs to one page at a time, the one that came last.

    :param fresh: makes a new session.
    :param place: where sessions are kept; None for nowhere.
    """

    def __init__(self, fresh: Callable[[], Session], place: Path | None,
                 most: int = MOST_PROCESSES, warm: bool = False) -> None:
        self._fresh, self.place, self._most = fresh, place, most
        self.open: dict[str, OpenSession] = {}
        self._passing: TemporaryDirectory[str] | None = None
        # The first page finds a process that is warm already.
        self._spare: list[Worker] = [Worker(warm=True)] if warm else []

    def attach(self, identity: str, page: object) -> OpenSession:
        """Give a page the session of that name, or a new one where there is none."""
        found = self.open.get(identity) or self._kept(identity) or self._new()
        found.page = page
        self._forget_old()
        found.start()
        return found

    def detach(self, page: object) -> None:
        """Take note that a page is gone; what it began goes on to its end."""
        for one in self.open.values():
            if one.page is page:
                one.page, one.left = None, time.monotonic()

    def brought(self, identity: str) -> Path:
        """Return where recordings lie that a browser brings to a session."""
        if self.place is not None:
            return self.place / 'recordings' / identity
        if self._passing is None:
            self._passing = TemporaryDirectory(prefix='gravity_comp')
        return Path(self._passing.name) / identity

    def poll(self) -> None:
        """Take what the processes have done, and end those that nobody waits for."""
        for one in list(self.open.values()):
            one.poll()
            gone = one.page is None and time.monotonic() - one.left > _PATIENCE
            if gone and not one.worker.busy:
                one.worker.rest()

    def earlier(self, own: str = '') -> list[store.SavedSession]:
        """Return the sessions that can be gone on with, the newest first."""
        if self.place is None:
            return []
        return [saved for saved in store.listed(self.place) if saved.id != own]

    def close(self) -> None:
        """End all work."""
        for worker in [*self._spare, *(one.worker for one in self.open.values())]:
            worker.close()
        if self._passing is not None:
            self._passing.cleanup()

    def _new(self) -> OpenSession:
        return self._opened(secrets.token_hex(8), self._fresh())

    def _kept(self, identity: str) -> OpenSession | None:
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
        """Return whether one more process may start; idle ones of others make room."""
        others = [one for one in self.open.values() if one is not asking and one.worker.alive]
        idle = [one for one in others if not one.worker.busy]
        for one in sorted(idle, key=lambda one: one.page is not None):
            if len(others) < self._most:
                break
            one.worker.rest()
            others.remove(one)
        return len(others) < self._most

    def _forget_old(self) -> None:
        """Let go of sessions that nobody looks at; they are kept on disk."""
        unseen = sorted((one for one in self.open.values()
                         if one.page is None and not one.worker.busy), key=lambda one: one.left)
        for one in unseen[:max(len(self.open) - _MOST_OPEN, 0)]:
            one.close()
            del self.open[one.id]
