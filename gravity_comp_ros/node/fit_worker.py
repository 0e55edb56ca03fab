"""What the fit process of the node does with a job, so that the node's own never waits."""

from __future__ import annotations

from gravity_comp_ros.node.fit_job import work
from gravity_comp_ros.node.fit_messages import Findings, Look, Outcome, Question, Seen
from gravity_comp_ros.node.fit_process import AnyJob
from gravity_comp_ros.node.fit_questions import ask, look
from gravity_comp_ros.worker.serve import Tell, Work


def fitting() -> Work:
    """Return what does the jobs of the node."""
    return do


def do(job: AnyJob, tell: Tell) -> Outcome | Findings | Seen:
    """Do a job of any kind."""
    if isinstance(job, Question):
        return ask(job)
    return look(job) if isinstance(job, Look) else work(job)
