"""One task of a fleet, whose errors become results, so that the other tasks go on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from gravity_comp_ros.errors import GravityCompError

Item = TypeVar('Item')
Result = TypeVar('Result')
Task = Callable[[Item], Result]
# Number of dead workers after which a task has failed.
ATTEMPTS = 3


@dataclass(frozen=True)
class Failure:
    """Failure of a task, with its reason in one line."""

    reason: str


def attempt(task: Task[Item, Result], item: Item) -> Result | Failure:
    """Return the result of a task, or its error as a `Failure`."""
    try:
        return task(item)
    except GravityCompError as error:
        return Failure(str(error))
    except Exception as error:  # other tasks must go on
        return Failure(f'internal error: {type(error).__name__}: '
                       + ' '.join(str(error).split()))


def died() -> Failure:
    """Return the failure of a task whose workers all died."""
    return Failure(f'its worker died {ATTEMPTS} times, possibly out of memory')
