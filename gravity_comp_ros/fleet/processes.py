"""
Execution of tasks in worker processes of this machine.

A worker has one task at a time. If it dies, its task is tried again by a new one; the other
workers go on. (A `ProcessPoolExecutor` breaks as a whole, and waits for ever if a task is
submitted while a worker dies, as seen with Python 3.11.)
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from gravity_comp_ros.errors import DataError
from gravity_comp_ros.fleet.attempt import attempt, ATTEMPTS, died, Failure, Item, Result, Task
from gravity_comp_ros.worker.messages import Done, Failed, Lost
from gravity_comp_ros.worker.worker_process import command, wait_for_messages, WorkerProcess

_WORK = f'{__name__}:work'
# Time for a process to end, s; one that is blocked in the kernel ends later.
_LAST_WAIT = 0.5
# Messages that end a job.
_ENDS = (Done, Failed, Lost)


def work() -> Callable[..., Any]:
    """Return the job function of the workers: a job is a task with its item."""
    return lambda job, report: attempt(*job)


def in_processes(count: int, task: Task[Item, Result],
                 items: Sequence[Item]) -> Iterator[tuple[int, Result | Failure]]:
    """
    Yield the index of each item with its result or a `Failure`, in order of completion.

    :param count: number of worker processes.
    :raises DataError: if a process cannot be started.
    """
    waiting = deque((number, 1) for number in range(len(items)))
    idle = [WorkerProcess(command(_WORK, 0)) for _ in range(min(count, len(items)))]
    # Number of the item and of the attempt.
    busy: dict[WorkerProcess, tuple[int, int]] = {}
    try:
        while waiting or busy:
            while waiting and idle:
                number, tries = waiting.popleft()
                worker = idle.pop()
                busy[worker] = number, tries
                _send(worker, (task, items[number]))
            for worker in wait_for_messages(list(busy)):
                end = next((m for m in worker.messages() if isinstance(m, _ENDS)), None)
                if end is None:
                    continue
                number, tries = busy.pop(worker)
                idle.append(worker)
                if isinstance(end, Done):
                    yield number, end.answer
                elif isinstance(end, Failed):
                    yield number, Failure(end.reason)
                elif tries == ATTEMPTS:
                    yield number, died()
                else:
                    waiting.appendleft((number, tries + 1))
    finally:
        for worker in (*idle, *busy):
            worker.end(_LAST_WAIT)


def _send(worker: WorkerProcess, job: tuple[Task[Item, Result], Item]) -> None:
    if worker.pid is None:
        try:
            worker.start()
        except OSError as problem:
            raise DataError(f'a worker process cannot be started: {problem}') from None
    worker.send(job)
