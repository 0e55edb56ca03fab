"""Parallel reading of bags, one process per bag."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
import os
from pathlib import Path
from typing import TypeVar

from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.recordings.gated_bag import GatedRecording, read_gated
from gravity_comp_ros.recordings.storage import data_files

T = TypeVar('T')
R = TypeVar('R')

# Data per worker process, bytes; less is read faster in this process.
_BYTES_PER_PROCESS = 100e6


def read_gated_bags(paths: Sequence[Path], options: ReadOptions = ReadOptions(),
                    gate: GateOptions = GateOptions()) -> Iterator[GatedRecording]:
    """
    Yield the slow samples of each bag, in order; large bags are read in parallel processes.

    :raises BagError: as `read_gated`, when that bag is reached.
    :raises ModelMismatchError: likewise.
    """
    yield from in_processes(partial(read_gated, options=options, gate=gate), paths,
                            workers(paths))


def workers(paths: Iterable[Path]) -> int:
    """Return the number of processes for these bags, by their total size."""
    paths = list(paths)
    by_size = int(sum(_size(path) for path in paths) / _BYTES_PER_PROCESS)
    return max(1, min(len(paths), os.cpu_count() or 1, by_size))


def in_processes(function: Callable[[T], R], items: Sequence[T], count: int) -> Iterator[R]:
    """Yield the results in order; a count of 1 uses this process."""
    if count <= 1:
        yield from map(function, items)
        return
    # A fork would copy locks held by other threads.
    with ProcessPoolExecutor(count, mp_context=get_context('spawn')) as pool:
        yield from pool.map(function, items)


def _size(path: Path) -> int:
    try:
        return sum(file.stat().st_size for file in data_files(path))
    except (BagError, OSError):
        return 0  # refused later, when it is read
