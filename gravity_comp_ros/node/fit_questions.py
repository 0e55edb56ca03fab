"""What the fit process is asked beside fits: a missing effect, or another payload."""

from __future__ import annotations

import time

from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.node.base_chain import BaseChains
from gravity_comp_ros.node.fit_messages import Findings, Look, Question, Seen
from gravity_comp_ros.node.payload import PayloadFinding
from gravity_comp_ros.node.payload_evidence import find_payload
import numpy as np

_chains = BaseChains()


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
    Diagnose, and put the findings into words.

    :raises DataError: if there are too few samples.
    """
    start = time.monotonic()
    found = diagnose(question.samples, question.model)
    # Named as `gravity_comp add` and the parameter `effects` take them.
    ranking = ', '.join(f'{target(item.effect or "unexplained", item.joint)} ({item.verdict})'
                        for item in found.findings)
    lines = [wording.verdict(found), *([ranking] if ranking else []),
             f'{len(question.samples)} slow samples, {time.monotonic() - start:.1f} s']
    return Findings(question.number, ' | '.join(lines))
