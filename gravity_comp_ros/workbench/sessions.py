"""All sessions of one server."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import secrets
from tempfile import TemporaryDirectory

from gravity_comp_ros.errors import GravityCompError, OptionError
from gravity_comp_ros.workbench import store
from gravity_comp_ros.workbench.jobs import Worker
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.stages import State

# Each session with a page has a process of at least 80 MB.
MAX_OPEN = 8


class Sessions:
    """
    The open sessions. A session belongs to one page at a time, the most recent one.

    :param start: initial state of a new session.
    :param place: folder of saved sessions; None to save none.
    """

    def __init__(self, start: State, place: Path | None,
                 new_worker: Callable[[], Worker] = Worker) -> None:
        self._start, self.place, self._new_worker = start, place, new_worker
        self.open: dict[str, Session] = {}
        self._temporary: TemporaryDirectory[str] | None = None

    def attach(self, identity: str, page: object) -> Session:
        """
        Return the session with this id for a page, or a new one if there is none.

        :raises OptionError: if too many sessions have a page.
        """
        session = self.open.get(identity)
        if session is None:
            self._make_room()
            session = self._opened(identity)
            self.open[session.id] = session
        session.page = page
        session.start()
        return session

    def detach(self, page: object) -> None:
        """Detach a closed page; its running job continues."""
        for session in self.open.values():
            if session.page is page:
                session.page = None

    def upload_folder(self, identity: str) -> Path:
        """Return the folder of the uploaded recordings of a session."""
        if self.place is not None:
            return self.place / 'recordings' / identity
        if self._temporary is None:
            self._temporary = TemporaryDirectory(prefix='gravity_comp')
        return Path(self._temporary.name) / identity

    def poll(self) -> None:
        """Process the events of all workers."""
        for session in list(self.open.values()):
            session.poll()

    def earlier(self, own: str = '') -> list[store.Entry]:
        """Return the saved sessions, the newest first."""
        if self.place is None:
            return []
        return [entry for entry in store.listed(self.place) if entry.id != own]

    def close(self) -> None:
        """End all workers."""
        for session in self.open.values():
            session.worker.rest()
        if self._temporary is not None:
            self._temporary.cleanup()

    def _opened(self, identity: str) -> Session:
        """Return the saved session with this id, or a new one."""
        warning = ''
        if identity and self.place is not None:
            try:
                return Session(store.load(self.place, identity), self._new_worker(), identity,
                               self.place)
            except GravityCompError as problem:
                warning = str(problem)
        session = Session(self._start, self._new_worker(), secrets.token_hex(8), self.place)
        session.warning = warning
        return session

    def _make_room(self) -> None:
        """Close the oldest session without a page or a job; it remains saved on disk."""
        if len(self.open) < MAX_OPEN:
            return
        idle = [session for session in self.open.values()
                if session.page is None and session.worker.job is None]
        if not idle:
            raise OptionError(f'{MAX_OPEN} sessions are open: close the page of one of them')
        idle[0].worker.rest()
        del self.open[idle[0].id]
