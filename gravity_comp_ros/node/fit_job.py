"""What the fit process does: fit and judge the result on held-out samples, or diagnose."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
import time

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.effects.predict import effect_torque, predict_torque
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import DataError, FitError
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.estimation.fit_with_effects import fit_with_effects
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.model_acceptance import judge, Prediction, Verdict

# Fewer samples do not tell a whole model: it would fit them, and be wrong where the arm goes
# next. What changed of an old model takes a fraction of them; see docs/node.md.
FROM_NOTHING = 100


@dataclass(frozen=True)
class Job:
    """
    What to fit: samples to learn from and to judge by.

    `base` is the model that was in use when the epoch began, to which a change may be fitted;
    `old` the one in use now, which is to be beaten. `effects` are to be in a whole model; `asked`
    says that somebody waits for it.
    """

    number: int
    epoch: int
    train: JointSamples
    held: JointSamples
    base: GravityModel | None
    old: GravityModel | None
    options: FitOptions
    effects: tuple[str, ...] = ()
    asked: bool = False


@dataclass(frozen=True)
class Outcome:
    """The best model of a job, how it fared against the one in use, and the time in s."""

    number: int
    epoch: int
    model: GravityModel
    verdict: Verdict
    how: str
    seconds: float


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
    lines = [wording.verdict(found), *([ranking] if ranking else []),
             f'{len(question.samples)} slow samples, {time.monotonic() - start:.1f} s']
    return Findings(question.number, ' | '.join(lines))


def work(job: Job) -> Outcome:
    """
    Fit a job and judge the result on its held-out samples.

    With few samples and a base only the change of that is fitted; with more a whole model as
    well, and the one that predicts the held-out samples better counts. Where somebody asked for
    effects that the base does not have, only a whole model will do.

    :raises FitError: if there is no result, or too few samples for the effects.
    :raises DataError: if the samples do not show an effect that was asked for.
    """
    start = time.monotonic()
    found = list(_candidates(job))
    how, model = found[0]
    here = predicted(model, job)
    for name, other in found[1:]:
        there = predicted(other, job)
        if judge(there, here, job.train, job.held).better:
            how, model, here = name, other, there
    more = job.old is not None and len(job.train) > job.old.coverage.n_samples
    verdict = judge(here, None if job.old is None else predicted(job.old, job), job.train,
                    job.held, more)
    return Outcome(job.number, job.epoch, model, verdict, how, time.monotonic() - start)


def _candidates(job: Job) -> Iterator[tuple[str, GravityModel]]:
    base = job.base
    if base is not None and (base.energy is None or base.joints != job.train.names):
        base = None
    wanted = requests(job.effects, job.train.names)
    news = [request.target for request in wanted
            if base is None or not base.applied.has(request.effect.name, request.joint)]
    if job.asked and news:
        base = None
        if len(job.train) < FROM_NOTHING:
            raise FitError(f'{len(job.train)} samples to learn from; a model with '
                           f'{", ".join(job.effects)} takes {FROM_NOTHING}: keep moving slowly')
    if base is not None:
        yield 'change of the old model', changed(base, job.train)
    if base is None:
        yield 'fit from nothing', whole(job)
    elif len(job.train) >= FROM_NOTHING:
        # There is a result already; samples that show too little for a whole one do no harm.
        with suppress(FitError, DataError):
            yield 'fit from nothing', whole(job)


def changed(base: GravityModel, samples: JointSamples) -> GravityModel:
    """Return the base with what changed of its gravity; its effects stay as they are."""
    gravity = replace(samples, tau=samples.tau - effect_torque(base, samples))
    return update(base, gravity).model


def whole(job: Job) -> GravityModel:
    """Return a model fitted to the samples alone, with the effects that are asked for."""
    # What the model in use was given stays, unless other effects are asked for.
    targets = job.effects or tuple(e.target for e in job.old.applied.effects) if job.old \
        else job.effects
    wanted = requests(targets, job.train.names)
    if not wanted:
        return fit(job.train, job.options).model
    return fit_with_effects(job.train, job.train, wanted, job.options).joint.model


def predicted(model: GravityModel, job: Job) -> Prediction:
    """Return what a model says of the samples of a job, effects included."""
    return Prediction(predict_torque(model, job.train), predict_torque(model, job.held),
                      model.noise)
