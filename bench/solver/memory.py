"""Peak memory of a call, in addition to that of the process before it."""

from __future__ import annotations

from collections.abc import Callable
import ctypes
import os
from pathlib import Path

_STATUS, _CLEAR = Path('/proc/self/status'), Path('/proc/self/clear_refs')


def peak_megabytes(call: Callable[..., object], *arguments: object) -> float:
    """Run a call in a fork of this process; return the growth of its peak memory in MB."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        try:
            # Reuse of freed memory that the allocator retains would not be counted.
            ctypes.CDLL(None).malloc_trim(0)
            _CLEAR.write_text('5')
            before = _field('VmHWM')
            call(*arguments)
            os.write(writer, str(_field('VmHWM') - before).encode())
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        kilobytes = pipe.read()
    os.waitpid(child, 0)
    return float(kilobytes) / 1e3 if kilobytes else float('nan')


def _field(name: str) -> float:
    line = next(x for x in _STATUS.read_text().splitlines() if x.startswith(name))
    return float(line.split()[1])
