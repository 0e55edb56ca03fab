"""
Execution of independent tasks: in this process, in worker processes, or on a Dask cluster.

A task is a module-level function of one argument. An error of a task, and the death of its
worker, become a `Failure`, so that the other tasks go on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from queue import SimpleQueue
from typing import TypeVar

from gravity_comp_ros.errors import DataError, GravityCompError

Item = TypeVar('Item')
Result = TypeVar('Result')
Task = Callable[[Item], Result]
# Number of dead workers after which a task has failed.
_ATTEMPTS = 3
# Timeout of the connection to a Dask scheduler, s.
_CONNECT = 30.0


@dataclass(frozen=True)
class Failure:
    """Failure of a task, with its reason in one line."""

    reason: str


# Index of the item, and its result.
Results = Iterator[tuple[int, Result | Failure]]


@dataclass(frozen=True)
class Engine:
    """
    Executor of tasks: the Dask cluster of `scheduler` if given, else `workers` processes.

    One worker is this process. Results are in order of completion.

    :raises DataError: if the scheduler cannot be reached, or dask is not installed.
    """

    workers: int = 1
    scheduler: str | None = None

    def run(self, task: Task[Item, Result], items: Sequence[Item]) -> Results[Result]:
        """Yield the index of each item with its result or a `Failure`, once per item."""
        if self.scheduler is not None:
            yield from _on_dask(self.scheduler, task, items)
        elif self.workers <= 1 or len(items) <= 1:
            yield from ((number, attempt(task, item)) for number, item in enumerate(items))
        else:
            yield from _in_processes(self.workers, task, items)


def attempt(task: Task[Item, Result], item: Item) -> Result | Failure:
    """Return the result of a task, or its error as a `Failure`."""
    try:
        return task(item)
    except GravityCompError as error:
        return Failure(str(error))
    except Exception as error:  # other tasks must go on
        return Failure(f'internal error: {type(error).__name__}: '
                       + ' '.join(str(error).split()))


def _in_processes(workers: int, task: Task[Item, Result], items: Sequence[Item]
                  ) -> Results[Result]:
    idle: SimpleQueue[_Process] = SimpleQueue()
    processes = [_Process() for _ in range(workers)]
    for process in processes:
        idle.put(process)

    def run(item: Item) -> Result | Failure:
        process = idle.get()
        try:
            return process.run(task, item)
        finally:
            idle.put(process)

    with ThreadPoolExecutor(workers) as threads:
        futures = {threads.submit(run, item): number for number, item in enumerate(items)}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        finally:
            threads.shutdown(cancel_futures=True)
            for process in processes:
                process.close()


class _Process:
    """
    A worker process that runs one task at a time, and is replaced when it dies.

    A dying worker breaks its whole pool, and a pool of several workers can wait for ever if a task
    is submitted at that moment (seen with Python 3.11). So each worker has a pool of its own.
    """

    def __init__(self) -> None:
        self._pool = _pool()

    def run(self, task: Task[Item, Result], item: Item) -> Result | Failure:
        """Return the result, or a `Failure` if workers die of the task."""
        for _ in range(_ATTEMPTS):
            try:
                return self._pool.submit(attempt, task, item).result()
            except BrokenProcessPool:
                self.close()
                self._pool = _pool()
        return _died(_ATTEMPTS)

    def close(self) -> None:
        self._pool.shutdown()


def _pool() -> ProcessPoolExecutor:
    # A fork would copy locks held by other threads.
    return ProcessPoolExecutor(1, mp_context=get_context('spawn'))


def _on_dask(address: str, task: Task[Item, Result], items: Sequence[Item]) -> Results[Result]:
    try:
        from distributed import as_completed as completed, Client, KilledWorker
    except ImportError:
        raise DataError('--scheduler needs dask: pip install distributed') from None
    try:
        client = Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise DataError(f'no Dask scheduler answers at {address}: '
                        f'{" ".join(str(error).split())}') from None
    with client, client.as_current():
        futures = {client.submit(attempt, task, item, pure=False): number
                   for number, item in enumerate(items)}
        # Dask reruns the tasks of a lost worker on another one.
        for future in completed(futures):
            number = futures.pop(future)
            problem = future.exception()
            if problem is None:
                yield number, future.result()
            elif isinstance(problem, KilledWorker):
                yield number, _died(_ATTEMPTS)
            else:
                yield number, Failure(' '.join(f'{type(problem).__name__}: {problem}'.split()))
            future.release()


def _died(times: int) -> Failure:
    return Failure(f'its worker died {times} times, possibly out of memory')
