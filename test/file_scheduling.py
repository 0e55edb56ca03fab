"""
Schedule of test files for pytest-xdist, robust to crashes of workers.

xdist's own `--dist loadfile` runs the crashed test a second time, assigns work to a worker that is
not ready, and then waits for ever for a worker with a single test (seen with xdist 3.8). This
schedule reports the crashed test as failed and assigns the other tests of its file to the
replacement of the worker.
"""

from __future__ import annotations

from xdist.scheduler import LoadFileScheduling
from xdist.workermanage import WorkerController

# Pending tests of a worker: it starts a test only if the next one is assigned.
QUEUED = 2


class FileScheduling(LoadFileScheduling):
    """Assignment of whole files to workers, in the order of collection."""

    def remove_node(self, node: WorkerController) -> str | None:
        """Remove a worker; return its crashed test, None if it had no pending test."""
        work = self.assigned_work.pop(node)
        self.registered_collections.pop(node, None)
        crashed = next((test for unit in work.values() for test, done in unit.items()
                        if not done), None)
        if crashed is None:
            return None
        for scope, unit in work.items():
            if crashed in unit:
                unit[crashed] = True
            if not all(unit.values()):
                self.workqueue[scope] = unit
                self.workqueue.move_to_end(scope, last=False)
        for other in self.assigned_work:
            self._reschedule(other)
        return crashed

    @property
    def collection_is_completed(self) -> bool:
        """Return whether every initial worker has collected, even if one has crashed since."""
        return self.collection is not None or super().collection_is_completed

    def _reschedule(self, node: WorkerController) -> None:
        """Assign files to a worker until it has enough tests; shut it down if none remain."""
        if node.shutting_down or node not in self.registered_collections:
            return
        while self.workqueue and self._pending_of(self.assigned_work[node]) <= QUEUED:
            self._assign_work_unit(node)
        if not self.workqueue:
            node.shutdown()
