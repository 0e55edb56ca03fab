"""
Which worker of pytest-xdist runs which file of tests, when workers may crash.

xdist's own `--dist loadfile` runs the test that crashed a second time, hands work to a worker
that is not ready, and then waits for ever for a worker that was given a single test (seen with
xdist 3.8). Here a crash costs one test: it is reported, and the rest of its file goes to the
worker that replaces the dead one.
"""

from __future__ import annotations

from xdist.scheduler import LoadFileScheduling
from xdist.workermanage import WorkerController

# A worker starts a test once it knows the next one, so it needs more than one.
QUEUED = 2


class FileScheduling(LoadFileScheduling):
    """Whole files to one worker after the other, in the order of collection."""

    def remove_node(self, node: WorkerController) -> str | None:
        """Take a worker away; return the test that it died of, None if it had none to do."""
        work = self.assigned_work.pop(node)
        self.registered_collections.pop(node, None)
        died_of = next((test for unit in work.values() for test, done in unit.items()
                        if not done), None)
        if died_of is None:
            return None
        for scope, unit in work.items():
            if died_of in unit:
                unit[died_of] = True
            if not all(unit.values()):
                self.workqueue[scope] = unit
                self.workqueue.move_to_end(scope, last=False)
        for other in self.assigned_work:
            self._reschedule(other)
        return died_of

    @property
    def collection_is_completed(self) -> bool:
        """Return whether every worker of the start has collected, also if one has died since."""
        return self.collection is not None or super().collection_is_completed

    def _reschedule(self, node: WorkerController) -> None:
        """Give a worker files until it has enough tests, or tell it that there are no more."""
        if node.shutting_down or node not in self.registered_collections:
            return
        while self.workqueue and self._pending_of(self.assigned_work[node]) <= QUEUED:
            self._assign_work_unit(node)
        if not self.workqueue:
            node.shutdown()
