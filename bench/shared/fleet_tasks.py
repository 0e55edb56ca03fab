"""Tasks for fleet workers; each worker imports this module, so its imports are few."""

from __future__ import annotations

import os
from pathlib import Path
import signal
import time

DEADLINE = 120.0


def die_once(path: str) -> str:
    """Kill the worker and create the file, unless the file exists; the next attempt succeeds."""
    if path and not os.path.exists(path):
        Path(path).write_text('died')
        os.kill(os.getpid(), signal.SIGKILL)
    return path


def die_of(word: str) -> str:
    if word == 'kill':
        os.kill(os.getpid(), signal.SIGKILL)
    return word


def process_id(item: int) -> int:
    return os.getpid()


def until_killed(log: str) -> int:
    """Append the process id to a log, then run until a worker was killed; return the id."""
    with open(log, 'a') as file:
        file.write(f'{os.getpid()}\n')
    end = time.monotonic() + DEADLINE
    while not os.path.exists(f'{log}.killed') and time.monotonic() < end:
        time.sleep(0.01)
    return os.getpid()
