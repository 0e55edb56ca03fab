"""Pending calls of `~/refit` and `~/diagnose`, and their replies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

Reply = Callable[[bool, str], None]


@dataclass(frozen=True)
class Request:
    """One call: its reply function, its deadline (s), and whether it requests a diagnosis."""

    reply: Reply
    until: float
    is_diagnosis: bool


class FitRequests:
    """One call at a time: queued until its job starts, then waiting for the end of that job."""

    def __init__(self) -> None:
        self.queued: Request | None = None
        self._waiting: tuple[int, Request] | None = None

    @property
    def is_busy(self) -> bool:
        return self.queued is not None or self._waiting is not None

    def queue(self, request: Request) -> None:
        """Keep a call until the fit process is ready for it."""
        self.queued = request

    def take(self) -> Request:
        """Remove and return the queued call."""
        request, self.queued = self.queued, None
        assert request is not None
        return request

    def wait(self, number: int, request: Request) -> None:
        """Reply to the call when job `number` has ended."""
        self._waiting = (number, request)

    def reply(self, number: int, success: bool, text: str) -> None:
        """Reply to the call that waits for job `number`, if there is one."""
        if self._waiting is not None and self._waiting[0] == number:
            request = self._waiting[1]
            self._waiting = None
            request.reply(success, text)

    def expire(self, now: float, process: str) -> None:
        """Reply to calls past their deadline; `process` is the state of the fit process."""
        if self.queued is not None and now > self.queued.until:
            self.take().reply(False, f'the fit process is {process}; try again')
        if self._waiting is not None and now > self._waiting[1].until:
            request, self._waiting = self._waiting[1], None
            request.reply(False, 'the fit is still running; its result will be in /diagnostics')

    def close(self) -> None:
        """Reply to all calls that the node shuts down."""
        pending = [self.queued, self._waiting[1] if self._waiting else None]
        self.queued = self._waiting = None
        for request in pending:
            if request is not None:
                request.reply(False, 'the node shuts down')
