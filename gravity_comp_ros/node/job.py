"""What the fit process does: fit and judge the result on held-out samples, or diagnose."""

from __future__ import annotations

from dataclasses import dataclass
import time

from gravity_comp_ros.diagnosis import words
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.gravity.applied import target
from gravity_comp_ros.gravity.fit import fit, FitOptions, FitResult
from gravity_comp_ros.gravity.model import GravityModel
from gravity_comp_ros.node.judge import judge, Verdict
from gravity_comp_ros.node.update import fit_change
from gravity_comp_ros.samples import JointSamples

# Below this the difference to the old model is told better than the whole; see docs/node.md.
FROM_NOTHING = 150


@dataclass(frozen=True)
class Job:
    """
    What to fit: samples to learn from and to judge by.

    `base` is the model that was in use when the epoch began, to which a change may be fitted;
    `old` the one in use now, which is to be beaten.
    """

    number: int
    epoch: int
    train: JointSamples
    held: JointSamples
    base: GravityModel | None
    old: GravityModel | None
    options: FitOptions


@dataclass(frozen=True)
class Outcome:
    """The best model of a job, how it fared against the one in use, and the time in s."""

    number: int
    epoch: int
    model: GravityModel
    verdict: Verdict
    how: str
    seconds: float
    warnings: tuple[str, ...]


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
    lines = [words.verdict(found), *([ranking] if ranking else []),
             f'{len(question.samples)} slow samples, {time.monotonic() - start:.1f} s']
    return Findings(question.number, ' | '.join(lines))


def work(job: Job) -> Outcome:
    """
    Fit a job and judge the result on its held-out samples.

    With few samples and a base only the difference to it is fitted; with many both that and
    the whole, and the one that predicts the held-out samples better counts.

    :raises FitError: if there is no result.
    """
    start = time.monotonic()
    base = job.base
    if base is not None and (base.joints != job.train.names or (base.energy is None) != (
            job.options.formulation == 'per_joint')):
        base = None
    candidates: list[tuple[str, FitResult]] = []
    if base is not None:
        candidates.append(('change of the old model', fit_change(job.train, base)))
    if base is None or len(job.train) >= FROM_NOTHING:
        candidates.append(('fit from nothing', fit(job.train, job.options)))
    how, best = candidates[0]
    for name, other in candidates[1:]:
        if judge(other.model, best.model, job.train, job.held).better:
            how, best = name, other
    more = job.old is not None and len(job.train) > job.old.coverage.n_samples
    verdict = judge(best.model, job.old, job.train, job.held, more)
    return Outcome(job.number, job.epoch, best.model, verdict, how, time.monotonic() - start,
                   tuple(str(word) for word in best.report.get('warnings', ())))
