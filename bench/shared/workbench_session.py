"""A session of the workbench whose jobs run in this process."""

from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.workbench.jobs import JobRunner, Step
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.stages import Choice
from gravity_comp_ros.worker.worker_process import Done, Failed


class InProcess:
    """A worker that runs a job when it is polled; `done` lists the jobs."""

    def __init__(self):
        self.job, self.done, self._runner = None, [], JobRunner()

    def start(self, job):
        self.job = job

    def cancel(self):
        self.job = None

    def rest(self):
        self.job = None

    def poll(self):
        job, self.job = self.job, None
        if job is None:
            return []
        self.done.append(job.step.name)
        try:
            return [(job, Done(self._runner(job, lambda stage, share: None)))]
        except GravityCompError as problem:
            return [(job, Failed(str(problem)))]


def session_of(*paths, choice=Choice(), given=()):
    """Return a session of recordings with no job done."""
    return Session(paths, choice, given, InProcess())


def worked(session, until=None):
    """
    Return the session after all its jobs.

    :param until: name of the first step that is not done any more.
    """
    last = None if until is None else Step[until]
    session.start()
    while session.worker.job is not None and session.worker.job.step is not last:
        session.poll()
    return session
