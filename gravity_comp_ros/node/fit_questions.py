"""What the fit process is asked beside fits: a missing effect, or another payload."""

from __future__ import annotations

from dataclasses import dataclass
import time

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node.base_chain import BaseChains
from gravity_comp_ros.node.payload_evidence import find_payload, PayloadFinding
from gravity_comp_ros.node.payload_test import PayloadLimits
import numpy as np

_chains = BaseChains()


@dataclass(frozen=True)
class Question:
    """Asks which effect is missing in `model`, going by these samples."""

    number: int
    samples: JointSamples
    model: GravityModel | None


@dataclass(frozen=True)
class Findings:
    """The answer to a question, in a line."""

    number: int
    text: str


@dataclass(frozen=True)
class Look:
    """Asks whether these samples show another payload than that of `model`; see `fit_job.Job`."""

    number: int
    samples: JointSamples
    model: GravityModel
    payload: PayloadLimits = PayloadLimits()
    geometry: Geometry | None = None


@dataclass(frozen=True)
class Seen:
    """The answer to a look, and the stamp of its first sample in s."""

    number: int
    finding: PayloadFinding
    since: float


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
