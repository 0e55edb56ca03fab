"""Several bags at a time, each read in a process of its own."""

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

# Less than this is read sooner than a second process starts.
_WORTH_A_PROCESS = 100e6


def read_gated_bags(paths: Sequence[Path], options: ReadOptions = ReadOptions(),
                    gate: GateOptions = GateOptions()) -> Iterator[GatedRecording]:
    """
    Yield the slow samples of each bag, in order; large bags are read in parallel processes.

    :raises BagError: as `read_gated`, when the turn of that bag comes.
    :raises ModelMismatchError: likewise.
    """
    yield from in_processes(partial(read_gated, options=options, gate=gate), paths,
                            workers(paths))


def workers(paths: Iterable[Path]) -> int:
    """Return how many processes are worth starting for these bags."""
    paths = list(paths)
    large = sum(_size(path) for path in paths) / _WORTH_A_PROCESS
    return max(1, min(len(paths), os.cpu_count() or 1, int(large)))


def in_processes(function: Callable[[T], R], items: Sequence[T], count: int) -> Iterator[R]:
    """Yield the results in order; with one process there is none beside this one."""
    if count <= 1:
        yield from map(function, items)
        return
    # A fork would carry over locks that other threads hold.
    with ProcessPoolExecutor(count, mp_context=get_context('spawn')) as pool:
        yield from pool.map(function, items)


def _size(path: Path) -> int:
    try:
        return sum(file.stat().st_size for file in data_files(path))
    except (BagError, OSError):
        return 0  # its turn to be refused comes later
