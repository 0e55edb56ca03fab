"""Messages of a worker process to its parent process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Ready:
    """The process has imported its modules and accepts jobs."""


@dataclass(frozen=True)
class Progress:
    """The progress of a job: its stage as text, and a share from 0 to 1."""

    stage: str
    share: float


@dataclass(frozen=True, eq=False)
class Done:
    """The result of a job."""

    answer: Any


@dataclass(frozen=True)
class Failed:
    """The reason of a job's failure, in one line."""

    reason: str


@dataclass(frozen=True)
class Lost:
    """The process has ended; `how` is its exit status as text."""

    how: str


Message = Ready | Progress | Done | Failed | Lost
