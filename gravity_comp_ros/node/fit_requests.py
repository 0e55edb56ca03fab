"""Those who called `~/refit` or `~/diagnose` and wait for what comes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

Reply = Callable[[bool, str], None]


@dataclass(frozen=True)
class Request:
    """One call: how to answer it, until when (s), and whether it asks for a diagnosis."""

    reply: Reply
    until: float
    is_question: bool


class FitRequests:
    """One call at a time: it is wanted until its job starts, then it waits for that job."""

    def __init__(self) -> None:
        self.wanted: Request | None = None
        self._waiting: tuple[int, Request] | None = None

    @property
    def is_busy(self) -> bool:
        return self.wanted is not None or self._waiting is not None

    def want(self, request: Request) -> None:
        """Keep a call until the fit process is ready for it."""
        self.wanted = request

    def take(self) -> Request:
        """Return the wanted call, which now is somebody else's to answer."""
        request, self.wanted = self.wanted, None
        assert request is not None
        return request

    def wait(self, number: int, request: Request) -> None:
        """Answer the call once job `number` has ended."""
        self._waiting = (number, request)

    def reply(self, number: int, success: bool, text: str) -> None:
        """Answer whoever waits for job `number`."""
        if self._waiting is not None and self._waiting[0] == number:
            request = self._waiting[1]
            self._waiting = None
            request.reply(success, text)

    def expire(self, now: float, process: str) -> None:
        """Answer those whose time has run out; `process` says how the fit process is."""
        if self.wanted is not None and now > self.wanted.until:
            self.take().reply(False, f'the fit process is {process}; try again')
        if self._waiting is not None and now > self._waiting[1].until:
            request, self._waiting = self._waiting[1], None
            request.reply(False, 'the fit still runs; its outcome will be in /diagnostics')

    def close(self) -> None:
        """Answer everybody: the node ends."""
        every = [self.wanted, self._waiting[1] if self._waiting else None]
        self.wanted = self._waiting = None
        for request in every:
            if request is not None:
                request.reply(False, 'the node shuts down')
