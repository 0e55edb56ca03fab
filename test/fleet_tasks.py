"""Tasks for workers of a fleet: each worker imports this module, so it imports little."""

from __future__ import annotations

import os
from pathlib import Path
import signal
import time

DEADLINE = 120.0


def die_once(path: str) -> str:
    """Kill the worker unless the file is there; one more attempt then succeeds."""
    if path and not os.path.exists(path):
        Path(path).write_text('died')
        os.kill(os.getpid(), signal.SIGKILL)
    return path


def die_of(word: str) -> str:
    if word == 'kill':
        os.kill(os.getpid(), signal.SIGKILL)
    return word


def until_killed(log: str) -> int:
    """Say which process works, then work until one was killed; return which process it is."""
    with open(log, 'a') as file:
        file.write(f'{os.getpid()}\n')
    end = time.monotonic() + DEADLINE
    while not os.path.exists(f'{log}.killed') and time.monotonic() < end:
        time.sleep(0.01)
    return os.getpid()
