"""
Execution of independent tasks: in this process, in worker processes, or on a Dask cluster.

A task is a module-level function of one argument. An error of a task, and the death of its
worker, become a `Failure`, so that the other tasks go on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from gravity_comp_ros.errors import DataError
from gravity_comp_ros.fleet.attempt import attempt, died, Failure, Item, Result, Task
from gravity_comp_ros.fleet.processes import in_processes

# Timeout of the connection to a Dask scheduler, s.
_CONNECT = 30.0

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
            yield from in_processes(self.workers, task, items)


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
                yield number, died()
            else:
                yield number, Failure(' '.join(f'{type(problem).__name__}: {problem}'.split()))
            future.release()
