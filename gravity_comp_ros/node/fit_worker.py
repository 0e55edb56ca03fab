"""Entry point of the fit process: fits, diagnoses and payload tests."""

from __future__ import annotations

import time

from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.node.base_chain import BaseChains
from gravity_comp_ros.node.fit_job import run_fit
from gravity_comp_ros.node.fit_messages import (
    DiagnosisJob, DiagnosisResult, FitResult, PayloadJob, PayloadResult)
from gravity_comp_ros.node.fit_process import AnyJob
from gravity_comp_ros.node.payload import PayloadFinding
from gravity_comp_ros.node.payload_evidence import find_payload
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.worker.serve import ProgressCallback, Work
import numpy as np

_chains = BaseChains()


def fitting() -> Work:
    """Return the function that runs the jobs of the node."""
    return run_job


def run_job(job: AnyJob, _: ProgressCallback) -> FitResult | DiagnosisResult | PayloadResult:
    """Run a job of any kind."""
    if isinstance(job, DiagnosisJob):
        return run_diagnosis(job)
    return run_payload_test(job) if isinstance(job, PayloadJob) else run_fit(job)


def run_payload_test(job: PayloadJob) -> PayloadResult:
    """Return whether the samples show another payload."""
    chain = _chains.of(job.model, job.geometry)
    if chain is None or chain.joints != job.samples.names:
        finding = PayloadFinding(False, True, 'the effort has changed; a payload cannot be '
                                 'tested, because no serial chain explains this arm')
    else:
        try:
            finding = find_payload(job.samples, job.model, chain, job.payload, job.geometry)
        except (GravityCompError, np.linalg.LinAlgError) as problem:
            finding = PayloadFinding(False, False, str(problem))
    return PayloadResult(job.number, finding, float(job.samples.t[0]))


def run_diagnosis(job: DiagnosisJob) -> DiagnosisResult:
    """
    Return the findings of a diagnosis, and the motion that resolves the open ones, as text.

    :raises DataError: if there are too few samples.
    """
    start = time.monotonic()
    diagnosis = diagnose(job.samples, job.model)
    # Named as `gravity_comp add` and the parameter `effects` accept them.
    ranking = ', '.join(f'{target(item.effect or "unexplained", item.joint)} ({item.verdict})'
                        for item in diagnosis.findings)
    lines = [wording.verdict(diagnosis), *filter(None, [ranking, _next_motion(job, diagnosis)]),
             f'{len(job.samples)} slow samples, {time.monotonic() - start:.1f} s']
    return DiagnosisResult(job.number, ' | '.join(lines))


def _next_motion(job: DiagnosisJob, diagnosis: Diagnosis) -> str:
    """Return the motion that resolves open findings as text; empty if there is none."""
    if job.model is None:
        return ''
    try:
        planned = plan(job.samples, job.model, diagnosis=diagnosis)
    except GravityCompError:
        return ''
    parts = '; '.join(part.sentence for part in planned.parts)
    return (f'to resolve open findings, move for {planned.trajectory.duration:.0f} s: {parts} '
            f'(`gravity_comp plan` on a recording writes that motion)')
