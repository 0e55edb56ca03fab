"""Assembly of a diagnosis from the selected effects: findings in order, and joint reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.alternative_models import best_alternative_model
from gravity_comp_ros.diagnosis.alternatives import alternatives
from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.criteria import Key
from gravity_comp_ros.diagnosis.error_metrics import ErrorMetrics
from gravity_comp_ros.diagnosis.estimates import estimates, half_widths
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding, FOUND, JointReport, Verdict
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.diagnosis.options import VerdictOptions
from gravity_comp_ros.diagnosis.pose_folds import pose_folds
from gravity_comp_ros.diagnosis.sample_size import (
    effective_sample_size, effective_sample_size_of)
from gravity_comp_ros.diagnosis.selection import Selection
from gravity_comp_ros.diagnosis.unexplained import (
    finding_of_alternative_model, finding_of_unknown_torque)
from gravity_comp_ros.diagnosis.verdict import (
    EffectEvidence, indistinguishable_confounders, possible_model_error, springs_of_offset,
    verdict)
from gravity_comp_ros.diagnosis.wording import evidence_sentence
from gravity_comp_ros.effects.effect import Expectation
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Minimum remaining error that is reported as unexplained: relative to the white noise, and to the
# torque range.
_NOISE_RATIO = 5.0
_MIN_REMAINING = 0.01


@dataclass(frozen=True, eq=False)
class Assembled:
    """
    A diagnosis; the effects in it; and those that are weak only because of another effect.

    `effects` are the selected ones except those that an unexplained torque supersedes.
    `unresolved` correct an effect that is itself unresolved.
    """

    diagnosis: Diagnosis
    effects: tuple[Candidate, ...]
    unresolved: frozenset[Key]


def assemble(selection: Selection, motion: Motion, span: FloatArray, noise: FloatArray,
             options: VerdictOptions = VerdictOptions()) -> Assembled:
    """
    Return the findings, the strongest first, with the reports of all joints.

    :param span: (N,) the range of the measured torque in N·m, to which errors are relative.
    :param noise: (N,) standard deviation of the white noise of the torque in N·m.
    """
    criteria = selection.criteria
    metrics = ErrorMetrics(criteria, motion, span)
    layout, chosen = criteria.fits.layout, selection.chosen
    refused = dict(selection.refused)
    findings: list[Finding] = []
    other = best_alternative_model(criteria, layout.alternatives, chosen)
    if other is not None:
        finding, chosen = finding_of_alternative_model(metrics, other, chosen)
        findings = [finding]
        refused[other.model.effect.name, other.trial.joint] = other.model.meaning
    unexplained = {finding.joint for finding in findings}
    for joint, name in enumerate(metrics.names):
        if name not in unexplained:
            of_joint, chosen = finding_of_unknown_torque(metrics, joint, chosen, layout.unknown,
                                                         refused)
            findings += filter(None, [of_joint])
    of_effects = _Findings(Selection(chosen, refused, criteria), metrics, options)
    findings += of_effects.all()
    findings.sort(key=lambda f: f.verdict not in FOUND)
    arm = {effect: reason for (effect, joint), reason in layout.untestable.items()
           if joint is None}
    reports = {name: _report(metrics, n, float(noise[n]), chosen, findings, options)
               for n, name in enumerate(metrics.names)}
    return Assembled(Diagnosis(tuple(findings), reports, arm), chosen,
                     frozenset(of_effects.unresolved))


class _Findings:
    """The findings of selected effects."""

    def __init__(self, selection: Selection, metrics: ErrorMetrics,
                 options: VerdictOptions) -> None:
        self.criteria, self.selection = selection.criteria, selection
        self.metrics, self.options = metrics, options
        self.fits = selection.fits
        self.chosen = _in_order(self.fits, selection.chosen)
        self._widths: dict[int, FloatArray] = {}
        folds = pose_folds(metrics.motion.samples, self.fits.blocks)
        self.unresolved: set[Key] = set()
        self._by_pose: tuple[Fits, list[Candidate]] | None = None
        if self.chosen and folds is not None:
            self._by_pose = self.fits.refolded(self.chosen, folds)

    def all(self) -> list[Finding]:
        """Return one finding for each effect, in order of decreasing reduction of the error."""
        findings = [self._finding(number) for number in range(len(self.chosen))]
        return [self._with_parent(finding, candidate, findings)
                for finding, candidate in zip(findings, self.chosen)]

    def _with_parent(self, finding: Finding, candidate: Candidate,
                     findings: Sequence[Finding]) -> Finding:
        """Return a finding as weak if it corrects another effect that is itself unresolved."""
        corrects = candidate.effect.corrects
        given = any((name, candidate.joint) in self.criteria.given for name in corrects)
        if finding.verdict not in FOUND or not corrects or given:
            return finding
        parents = [f for f in findings if f.effect in corrects and f.joint == finding.joint]
        if not parents or any(f.verdict in FOUND or set(f.rivals) & set(corrects)
                              for f in parents):
            return finding
        self.unresolved.add(candidate.key)
        names = ' or '.join(str(f.effect) for f in parents)
        return replace(finding, verdict=Verdict.WEAK, next_step=self._experiment(candidate),
                       why=f'{finding.why}; it corrects {names}, which is unresolved')

    def _finding(self, number: int) -> Finding:
        candidate, metrics = self.chosen[number], self.metrics
        joint = None if candidate.joint is None else metrics.names[candidate.joint]
        evidence = self._evidence(number)
        level, reason = verdict(self.fits, self.chosen, candidate, evidence, self.options)
        why = evidence_sentence(candidate.effect.title, joint or 'the whole arm', evidence.before,
                                evidence.after, evidence.gain.p)
        next_step = '' if level in FOUND else self._experiment(candidate)
        return Finding(
            joint, candidate.effect.name, level,
            evidence.alternatives or evidence.indistinguishable, evidence.sizes, evidence.before,
            evidence.after, self.fits.absorbed(candidate), evidence.runs_better,
            f'{why}; {reason}' if reason else why, next_step, evidence.gain.p,
            dict(candidate.setting))

    def _experiment(self, candidate: Candidate) -> str:
        """Return the motion that distinguishes an effect from similar ones."""
        joint = 'the arm' if candidate.joint is None else self.metrics.names[candidate.joint]
        return candidate.effect.experiment.replace('{joint}', joint)

    def _evidence(self, number: int) -> EffectEvidence:
        candidate, metrics, motion = self.chosen[number], self.metrics, self.metrics.motion
        rest = [c for c in self.chosen if c is not candidate]
        gain = self.criteria.gain_given(candidate, rest)
        joint = self._most_affected(candidate, rest)
        before, after = (metrics.nrmse(chosen, joint) for chosen in (
            self.chosen[:number], self.chosen[:number + 1]))
        return EffectEvidence(
            gain, gain.p < self.criteria.options.alpha, metrics.runs_better(gain), before, after,
            effective_sample_size_of(self.fits, motion, joint, self.chosen, candidate),
            self._alternatives(candidate),
            indistinguishable_confounders(self.fits, motion, candidate, self.options),
            estimates(self.fits, self.chosen, motion, candidate,
                      self._half_widths(candidate.joint_index)),
            candidate.n_free(motion), self.criteria.unphysical(candidate, self.chosen),
            metrics.unabsorbed(candidate),
            possible_model_error(self.fits, candidate, self.chosen, self.options),
            self._errors_at_new_poses(number))

    def _alternatives(self, candidate: Candidate) -> tuple[str, ...]:
        """Return the alternative explanations, with their joint if that is another one."""
        names = self.metrics.names
        equivalent = alternatives(self.selection, candidate, self.chosen)
        return tuple(c.effect.name if c.joint == candidate.joint or c.joint is None
                     else f'{c.effect.name}:{names[c.joint]}' for c in equivalent
                     ) + springs_of_offset(self.fits, self.metrics.motion, candidate, self.chosen)

    def _half_widths(self, joint: int) -> FloatArray:
        if joint not in self._widths:
            self._widths[joint] = half_widths(self.fits, self.chosen, joint, self.metrics.motion)
        return self._widths[joint]

    def _errors_at_new_poses(self, number: int) -> tuple[FloatArray, FloatArray] | None:
        """Return errors without and with an effect, with folds by pose."""
        if self._by_pose is None:
            return None
        fits, chosen = self._by_pose
        candidate = chosen[number]
        joint = candidate.acts_on
        rest = [c for c in chosen if c is not candidate]
        return fits.errors(joint, rest), fits.errors(joint, chosen)

    def _most_affected(self, candidate: Candidate, rest: Sequence[Candidate]) -> int:
        """Return the joint of an effect, or the one whose error it reduces most."""
        if not candidate.shared:
            return candidate.joint_index
        with_it, = self.fits.errors_with_each(None, rest, [candidate])
        return int(np.argmax((self.fits.errors(None, rest) - with_it).sum(axis=0)))


def _in_order(fits: Fits, chosen: Sequence[Candidate]) -> list[Candidate]:
    """
    Return effects so that each next one reduces the remaining error most.

    The gain of an effect usually falls as others are added, so only the best remaining one is
    computed again (lazy greedy ordering).
    """
    ordered: list[Candidate] = []
    gains = {c: float('inf') for c in chosen}
    current: set[Candidate] = set()
    while gains:
        best = max(gains, key=lambda c: gains[c])
        if best in current:
            ordered.append(best)
            del gains[best]
            # Effects of one joint affect those of another through gravity alone.
            current = {c for c in current if None not in (c.acts_on, best.acts_on)
                       and c.acts_on != best.acts_on}
        else:
            before = fits.errors(best.acts_on, ordered)
            after, = fits.errors_with_each(best.acts_on, ordered, [best])
            gains[best] = float((before - after).sum())
            current.add(best)
    return ordered


def _absorbed_effects(metrics: ErrorMetrics, n: int, findings: Sequence[Finding],
                      min_unabsorbed: float) -> dict[str, str]:
    """Return common effects of a joint that gravity absorbs, with the reason."""
    named, shares = {f.effect for f in findings}, {}
    # Reversed, so that the first candidate of a name, its simplest setting, counts.
    for c in reversed(metrics.criteria.candidates):
        if c.acts_on == n and c.effect.expectation == Expectation.COMMON \
                and c.effect.name not in named:
            shares[c.effect.name] = metrics.unabsorbed(c)
    return {name: f'gravity absorbs all but {share:.1%} of its torque in this motion'
            for name, share in shares.items() if share < min_unabsorbed}


def _report(metrics: ErrorMetrics, n: int, noise: float, chosen: Sequence[Candidate],
            findings: Sequence[Finding], options: VerdictOptions) -> JointReport:
    fits = metrics.criteria.fits
    here = [f for f in findings if f.joint == metrics.names[n]]
    untestable = {effect: reason for (effect, joint), reason in fits.layout.untestable.items()
                  if joint == n}
    untestable.update(_absorbed_effects(metrics, n, here, options.min_unabsorbed))
    remaining = fits.errors(n, chosen)
    rmse, share = metrics.rmse(remaining, n), metrics.nrmse_of(remaining, n)
    unexplained = rmse > _NOISE_RATIO * noise and share > _MIN_REMAINING
    parts = [f'{f.effect} ({f.verdict})' if f.effect else 'unexplained torque' for f in here]
    if unexplained:
        parts.append(f'{rmse:.3g} N·m ({share:.1%} of the torque range) remain unexplained')
    to_add = {(f.effect, f.joint) for f in findings if f.verdict in FOUND}
    added = [c for c in chosen if (c.effect.name, None if c.joint is None else
                                   metrics.names[c.joint]) in to_add]
    return JointReport(', '.join(parts) or 'no missing effect detectable in this recording',
                       noise, effective_sample_size(fits, metrics.motion, n, chosen),
                       metrics.rmse(fits.errors(n, []), n), metrics.rmse(fits.errors(n, added), n),
                       untestable, share if unexplained else 0.0)
