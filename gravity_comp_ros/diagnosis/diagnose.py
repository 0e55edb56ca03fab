"""
Diagnosis of a gravity model: which physical effects it does not predict.

The terms are those of the same estimate as in a fit (`estimation.estimate`). A finding is a term
that the model does not predict, with its evidence, its alternatives and its held-out error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding, FOUND, JointReport
from gravity_comp_ros.diagnosis.verdict import (
    DiagnosisOptions, Evidence, finding_of, finding_of_dynamics, unexplained)
from gravity_comp_ros.effects.registry import known_effect
from gravity_comp_ros.estimation.estimate import Estimate, estimate
from gravity_comp_ros.estimation.estimated_model import target_of
from gravity_comp_ros.estimation.refit import fit_options_of
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

Progress = Callable[[str, float], None]


def diagnose(samples: JointSamples, model: GravityModel | None = None,
             options: DiagnosisOptions = DiagnosisOptions(),
             progress: Progress | None = None) -> Diagnosis:
    """
    Return the effects that a gravity model does not predict.

    :param samples: one or several runs, including fast motion.
    :param model: the gravity model, including its effects; None fits one.
    :raises FitError: if there are too few samples.
    :raises ModelMismatchError: if a joint of the model is not among the samples.
    :raises OptionError: if an effect of the model is not installed and `effects` are given.
    """
    report = progress or (lambda word, share: None)
    if model is not None:
        samples = samples.joints(model.joints)
    report('estimate', 0.0)
    effects = None if options.effects is None else [
        known_effect(name) for name in dict.fromkeys((*options.effects, *_names(model)))]
    estimated = estimate(samples, old=model, effects=effects) if model is None else estimate(
        samples, fit_options_of(model), old=model, effects=effects)
    report('verdicts', 0.7)
    result = conclude(estimated, model, options)
    report('verdicts', 1.0)
    return result


def conclude(estimated: Estimate, model: GravityModel | None,
             options: DiagnosisOptions = DiagnosisOptions()) -> Diagnosis:
    """Return the findings of an estimate that a model does not predict."""
    evidence = Evidence.of(estimated, model, options)
    findings = _findings(evidence)
    findings.sort(key=lambda f: (f.verdict not in FOUND, -f.gain))
    reports = {name: _joint_report(evidence, n, name, findings)
               for n, name in enumerate(evidence.joints)}
    arm = {name: reason for (name, joint), reason in
           estimated.regression.candidates.untestable.items() if joint is None}
    return Diagnosis(tuple(findings), reports, arm)


def _findings(evidence: Evidence) -> list[Finding]:
    """Return one finding for each term that the model does not predict, and for the rest."""
    findings = []
    for term in evidence.estimated.regression.terms:
        name = target_of(term, evidence.joints)
        if name not in evidence.in_model:
            findings.append(finding_of(evidence, term))
        elif name in evidence.absorbed:
            findings.append(replace(finding_of(evidence, term), is_predicted=True, to_add=()))
    dynamics = finding_of_dynamics(evidence)
    findings += [] if dynamics is None else [dynamics]
    return [*findings, *unexplained(evidence)]


def _joint_report(evidence: Evidence, n: int, name: str,
                  findings: list[Finding]) -> JointReport:
    """Return the report of a joint: errors before and after, and what is not testable."""
    torques, predicted = evidence.torques, evidence.predicted
    added = {target(f.effect, f.joint) for f in findings
             if f.effect is not None and (f.to_add or f.is_predicted)}
    every = {*predicted, *torques.effects}
    before, after, rest = (float(torques.rmse(names)[n])
                           for names in (predicted, {*predicted, *added}, every))
    noise = float(_white(evidence.estimated)[n])
    untestable = {effect: reason for (effect, joint), reason in
                  evidence.estimated.regression.candidates.untestable.items() if joint == n}
    # An effect of the whole arm counts on the joints whose error it reduces.
    own = [f for f in findings if f.joint == name or (f.joint is None and after < before)]
    remaining = rest / float(evidence.span[n]) if rest > 2.0 * noise else 0.0
    return JointReport(_summary(own, before, after), noise, float(evidence.n_effective[n]),
                       before, after, untestable,
                       remaining if remaining > evidence.options.min_remaining else 0.0)


def _white(estimated: Estimate) -> FloatArray:
    """Return the white noise (N,) of a sample, N·m."""
    problem = estimated.regression.problem
    return problem.white_noise * np.sqrt(np.median(problem.n_measured))


def _summary(findings: list[Finding], before: float, after: float) -> str:
    if not findings:
        return 'no effect is missing that is detectable in this motion'
    listed = ', '.join(f'{f.effect or "unexplained torque"} ({f.verdict})' for f in findings)
    return f'{listed}; held-out error {before:.3g} → {after:.3g} N·m'


def _names(model: GravityModel | None) -> tuple[str, ...]:
    return () if model is None else tuple(e.name for e in model.applied.effects)
