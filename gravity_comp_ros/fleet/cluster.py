"""
Independent tasks on a Dask cluster: one of this machine, or that of a scheduler.

Dask sends pickled functions and data, so a program that reaches a scheduler or a worker can run
code there. The connections of this machine stay on the loopback interface, encrypted where the
package `cryptography` is installed; those of a scheduler with an address tls://HOST:PORT.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import importlib.util
from itertools import islice
import logging
import signal
import threading
from typing import TypeVar

from distributed import as_completed, Client, Future, KilledWorker, LocalCluster, Security
from gravity_comp_ros.errors import DataError, GravityCompError

Item = TypeVar('Item')
Result = TypeVar('Result')
# Timeout of the connection to a scheduler, s.
_CONNECT = 30.0


@dataclass(frozen=True)
class ClusterOptions:
    """
    Place of the tasks: `workers` processes of this machine, or the cluster of a scheduler.

    A single worker is a thread of this process. `scheduler` is an address; certificates for
    tls://HOST:PORT are in the configuration of Dask (`distributed.comm.tls`).
    """

    workers: int = 1
    scheduler: str | None = None

    @property
    def warning(self) -> str:
        """Return a warning if other hosts or users can reach the workers, else ''."""
        if self.scheduler is not None:
            return '' if self.scheduler.startswith('tls://') else (
                f'{self.scheduler} is not encrypted: a program that reaches it can run code on '
                'its workers and here; docs/fleet.md describes TLS')
        if self.workers > 1 and not _can_encrypt():
            return ('the workers are not encrypted: other users of this machine could run code in '
                    'them (pip install cryptography)')
        return ''


@dataclass(frozen=True)
class Failure:
    """Failure of a task, with its reason in one line."""

    reason: str


def run_tasks(options: ClusterOptions, task: Callable[[Item], Result],
              items: Sequence[Item]) -> Iterator[tuple[int, Result | Failure]]:
    """
    Yield the index of each item with its result or a `Failure`, in order of completion.

    Dask repeats the task of a worker that died.

    :param task: function of a module, of one argument.
    :raises DataError: if the scheduler cannot be reached.
    """
    with _client(options) as client, client.as_current():
        completed, numbers = as_completed(), dict[Future, int]()
        waiting = iter(enumerate(items))

        def submit() -> None:
            # One task a thread at most: a task that kills its worker takes no other with it.
            free = max(sum(client.nthreads().values()), 1) - len(numbers)
            for number, item in islice(waiting, max(free, 0)):
                future = client.submit(task, item, pure=False)
                numbers[future] = number
                completed.add(future)

        submit()
        for future in completed:
            number, error = numbers.pop(future), future.exception()
            yield number, future.result() if error is None else Failure(_reason(error))
            future.release()
            submit()


def _reason(error: BaseException) -> str:
    if isinstance(error, GravityCompError):
        return str(error)
    if isinstance(error, KilledWorker):
        return 'its workers died, possibly out of memory'
    return f'internal error: {type(error).__name__}: ' + ' '.join(str(error).split())


@contextmanager
def _client(options: ClusterOptions) -> Iterator[Client]:
    if options.scheduler is None:
        with _local_cluster(options) as cluster, \
                Client(cluster, set_as_default=False) as client:
            yield client
        return
    try:
        client = Client(options.scheduler, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise DataError(f'no Dask scheduler answers at {options.scheduler}: '
                        f'{" ".join(str(error).split())}') from None
    with client:
        yield client


def _local_cluster(options: ClusterOptions) -> LocalCluster:
    """Return a started cluster; an interrupt ends this process alone, which ends the others."""
    in_main = threading.current_thread() is threading.main_thread()
    # Processes inherit an ignored signal.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if in_main else None
    try:
        # No limit of memory: a worker could not go on with less than its recordings need.
        return LocalCluster(
            n_workers=options.workers, threads_per_worker=1, processes=options.workers > 1,
            memory_limit=0, dashboard_address=None, silence_logs=logging.CRITICAL,
            security=Security.temporary() if _can_encrypt() else None)
    finally:
        if in_main:
            signal.signal(signal.SIGINT, before)


def _can_encrypt() -> bool:
    return importlib.util.find_spec('cryptography') is not None
