"""What a worker process says to the one that started it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Ready:
    """It has imported what its jobs need, and waits for the first one."""


@dataclass(frozen=True)
class Progress:
    """How far a job is: its stage in words, and a share from 0 to 1."""

    stage: str
    share: float


@dataclass(frozen=True, eq=False)
class Done:
    """The answer to a job."""

    answer: Any


@dataclass(frozen=True)
class Failed:
    """Why a job has no answer, in one line."""

    reason: str


@dataclass(frozen=True)
class Lost:
    """The process is gone, and how it ended."""

    how: str


Message = Ready | Progress | Done | Failed | Lost
