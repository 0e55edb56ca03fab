"""
Run many independent tasks: in this process, in several of this machine, or on a Dask cluster.

A task is a function at the top of a module and one argument. It returns its result, or a
`Failure` in words; what a worker cannot say itself, because it was killed, becomes one here. So
one bad bag, or one lost worker, never ends the run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from typing import TypeVar

from gravity_comp_ros.errors import DataError, GravityCompError

Item = TypeVar('Item')
Result = TypeVar('Result')
Task = Callable[[Item], Result]
# A task during which workers die this often is not tried again.
_ATTEMPTS = 3
_CONNECT = 30.0  # s


@dataclass(frozen=True)
class Failure:
    """Why a task has no result, in one line."""

    reason: str


# The number of an item, and what came of it.
Results = Iterator[tuple[int, Result | Failure]]


@dataclass(frozen=True)
class Engine:
    """
    Where tasks run: on the Dask cluster of `scheduler` if that is given, else in `workers`.

    With one worker that is this process. Results come in the order in which they are ready.

    :raises DataError: when the scheduler cannot be reached, or dask is not installed.
    """

    workers: int = 1
    scheduler: str | None = None

    def run(self, task: Task[Item, Result], items: Sequence[Item]) -> Results[Result]:
        """Yield (number of the item, its result or a `Failure`) for every item, once."""
        if self.scheduler is not None:
            yield from _on_dask(self.scheduler, task, items)
        elif self.workers <= 1 or len(items) <= 1:
            yield from ((number, attempt(task, item)) for number, item in enumerate(items))
        else:
            yield from _in_processes(self.workers, task, items)


def attempt(task: Task[Item, Result], item: Item) -> Result | Failure:
    """Return the task's result, or its error as a `Failure`."""
    try:
        return task(item)
    except GravityCompError as error:
        return Failure(str(error))
    except Exception as error:  # a task must not end those of all others
        return Failure(f'internal error: {type(error).__name__}: '
                       + ' '.join(str(error).split()))


def _in_processes(workers: int, task: Task[Item, Result], items: Sequence[Item]
                  ) -> Results[Result]:
    left = set(range(len(items)))
    with _pool(workers) as pool:
        futures: dict[Future[Result | Failure], int] = {
            pool.submit(attempt, task, items[number]): number for number in sorted(left)}
        for future in as_completed(futures):
            if not isinstance(future.exception(), BrokenProcessPool):
                left.discard(futures[future])
                yield futures[future], future.result()
    # A worker that dies takes the pool with it, and does not say in which task. What is left
    # gets a process of its own each, so that only the task at fault is given up.
    for number in sorted(left):
        yield number, _alone(task, items[number])


def _alone(task: Task[Item, Result], item: Item) -> Result | Failure:
    for _ in range(_ATTEMPTS - 1):
        with _pool(1) as pool:
            future = pool.submit(attempt, task, item)
            if not isinstance(future.exception(), BrokenProcessPool):
                return future.result()
    return _died(_ATTEMPTS)


def _pool(workers: int) -> ProcessPoolExecutor:
    # A fork would carry over locks that other threads hold.
    return ProcessPoolExecutor(workers, mp_context=get_context('spawn'))


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
        # Dask runs the tasks of a lost worker again on another one, by itself.
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
    return Failure(f'its worker died {times} times, perhaps of too little memory')
