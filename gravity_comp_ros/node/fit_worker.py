"""What the fit process of the node does: fits, a missing effect, another payload."""

from __future__ import annotations

import time

from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.node.base_chain import BaseChains
from gravity_comp_ros.node.fit_job import work
from gravity_comp_ros.node.fit_messages import Findings, Look, Outcome, Question, Seen
from gravity_comp_ros.node.fit_process import AnyJob
from gravity_comp_ros.node.payload import PayloadFinding
from gravity_comp_ros.node.payload_evidence import find_payload
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.worker.serve import ProgressCallback, Work
import numpy as np

_chains = BaseChains()


def fitting() -> Work:
    """Return what does the jobs of the node."""
    return do


def do(job: AnyJob, tell: ProgressCallback) -> Outcome | Findings | Seen:
    """Do a job of any kind."""
    if isinstance(job, Question):
        return ask(job)
    return look(job) if isinstance(job, Look) else work(job)


def look(job: Look) -> Seen:
    """Return whether the samples show another payload."""
    chain = _chains.of(job.model, job.geometry)
    if chain is None or chain.joints != job.samples.names:
        found = PayloadFinding(False, True, 'the effort has changed; whether by a payload is not '
                               'known, because no serial chain explains this arm')
    else:
        try:
            found = find_payload(job.samples, job.model, chain, job.payload, job.geometry)
        except (GravityCompError, np.linalg.LinAlgError) as problem:
            found = PayloadFinding(False, False, str(problem))
    return Seen(job.number, found, float(job.samples.t[0]))


def ask(question: Question) -> Findings:
    """
    Diagnose, and put the findings and the motion that settles what they leave open into words.

    :raises DataError: if there are too few samples.
    """
    start = time.monotonic()
    found = diagnose(question.samples, question.model)
    # Named as `gravity_comp add` and the parameter `effects` take them.
    ranking = ', '.join(f'{target(item.effect or "unexplained", item.joint)} ({item.verdict})'
                        for item in found.findings)
    lines = [wording.verdict(found), *filter(None, [ranking, _next_motion(question, found)]),
             f'{len(question.samples)} slow samples, {time.monotonic() - start:.1f} s']
    return Findings(question.number, ' | '.join(lines))


def _next_motion(question: Question, found: Diagnosis) -> str:
    """Return the motion that settles what is open, in words; nothing if there is none."""
    if question.model is None:
        return ''
    try:
        planned = plan(question.samples, question.model, diagnosis=found)
    except GravityCompError:
        return ''
    parts = '; '.join(part.sentence for part in planned.parts)
    return (f'to settle what is open, move for {planned.trajectory.duration:.0f} s: {parts} '
            f'(`gravity_comp plan` on a recording writes that motion)')
