"""
Samples of a first model, judged as a recording is.

Without a model there is no reference: neither another unit nor a wrong sign contradicts one. The
facts about a recording show them (`facts.judge`, `estimation.torque_facts`). Later samples are
compared with the model (`hypotheses`).
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.joint_order import joint_order, NUMBERS, WORDS
from gravity_comp_ros.estimation.subset_stability import last_part
from gravity_comp_ros.estimation.torque_facts import torque_facts
from gravity_comp_ros.facts.fact import accepted_kinds, Action, Fact, Kind
from gravity_comp_ros.facts.judge import judge
from gravity_comp_ros.facts.signals import Signals
from gravity_comp_ros.node import checks
from gravity_comp_ros.node.checks import Check
from gravity_comp_ros.node.job_messages import Job
import numpy as np

# Facts that the input shows before, at the full rate (kept samples are seconds apart), and
# outliers, which a fit reports itself.
_ELSEWHERE = frozenset({Kind.VELOCITY, Kind.GLITCHES, Kind.WRAPS, Kind.SPIKES})


def judged(job: Job) -> tuple[Job, Check]:
    """
    Return a job without samples that are no measurements, and the check that it can be learned.

    The text of the check has the facts. A fact about the arm that the last samples do not show is
    no fault of the effort: in little motion several arms explain it, and the model has not
    converged.
    """
    samples = job.rows.samples
    none = np.zeros(samples.n_joints, dtype=bool)
    signals = Signals(samples.names, samples.t, samples.q, samples.qd, samples.tau,
                      np.arange(len(samples)), none)
    accept = accepted_kinds(job.settings.accept)
    judgement = judge(signals, np.ones(samples.n_joints), none, True, accept | _ELSEWHERE)
    kept = np.zeros(len(samples), dtype=bool)
    kept[judgement.signals.rows] = True
    rows = job.rows.select(kept)
    seen = [fact for fact in judgement.facts
            if fact.action in (Action.REFUSED, Action.LEFT_OUT)]
    of_arm = _facts_of_arm(job, rows.samples)
    refusals, structural = (
        [fact for fact in facts if fact.action is Action.REFUSED and fact.kind not in accept]
        for facts in (seen, of_arm))
    if structural:
        last = {(fact.kind, fact.joints) for fact in _facts_of_arm(job, last_part(rows.samples))}
        refusals += [fact for fact in structural if (fact.kind, fact.joints) in last]
    if structural and not refusals:
        return replace(job, rows=rows), Check(checks.CONVERGED, 1.0, 0.5, text=(
            f'{structural[0].evidence}, but the last samples do not show it: keep moving slowly'))
    text = '; '.join(map(_sentence, refusals or [*seen, *of_arm]))
    return replace(job, rows=rows), Check(checks.NO_FACT, float(len(refusals)), 0.0, text=text)


def _facts_of_arm(job: Job, samples: JointSamples) -> list[Fact]:
    """Return the facts that one arm for all joints shows."""
    geometry, order = job.geometry, joint_order(samples.names)
    return list(torque_facts(
        samples, None if geometry is None else geometry.rotations,
        by_name=geometry is None and order.joints == samples.names
        and order.source in (NUMBERS, WORDS)))


def _sentence(fact: Fact) -> str:
    """Return evidence and action of a fact, with the parameters that lift a refusal."""
    text = f'{fact.evidence}: {fact.done}'
    if fact.action is not Action.REFUSED:
        return text
    scaled = 'effort_scale, or ' * (fact.kind in (Kind.EFFORT_UNIT, Kind.EFFORT_SIGN,
                                                  Kind.EFFORT_GAIN))
    return f'{text} (parameter {scaled}accept: [{fact.kind.value}] if it is right)'
