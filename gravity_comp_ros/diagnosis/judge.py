"""From chosen effects to a diagnosis: findings in order, and a report of every joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.alternative_models import best_alternative
from gravity_comp_ros.diagnosis.alternatives import alternatives
from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.effective import effective, effective_of
from gravity_comp_ros.diagnosis.estimates import estimates, half_widths
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding, FOUND, JointReport, Verdict
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.diagnosis.options import VerdictOptions
from gravity_comp_ros.diagnosis.pose_folds import pose_folds
from gravity_comp_ros.diagnosis.scale import Scale
from gravity_comp_ros.diagnosis.selection import Selection
from gravity_comp_ros.diagnosis.unexplained import by_another_law, of_unknown_shape
from gravity_comp_ros.diagnosis.verdict import (
    Proof, remainder_of, rest_angles, untestable_twins, verdict)
from gravity_comp_ros.diagnosis.wording import evidence_sentence
from gravity_comp_ros.effects.effect import Expectation
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# A remaining error this many times the white noise, and of this share of the range of the torque,
# is not explained.
_FAR_ABOVE = 5.0
_LEAST_REMAINING = 0.01


@dataclass(frozen=True, eq=False)
class Judged:
    """A diagnosis, and the chosen effects that it names or leaves open."""

    diagnosis: Diagnosis
    chosen: tuple[Candidate, ...]


def judge(selection: Selection, motion: Motion, span: FloatArray, noise: FloatArray,
          options: VerdictOptions = VerdictOptions()) -> Judged:
    """
    Return findings, the strongest first, and reports of all joints.

    :param span: (N,) the range of the measured torque in N·m, of which errors are a fraction.
    :param noise: (N,) standard deviation of the white noise of the torque in N·m.
    """
    criteria = selection.criteria
    scale = Scale(criteria, motion, span)
    layout, chosen = criteria.fits.layout, selection.chosen
    refused = dict(selection.refused)
    findings: list[Finding] = []
    other = best_alternative(criteria, layout.alternatives, chosen)
    if other is not None:
        outcome = by_another_law(scale, other, chosen)
        findings, chosen = list(outcome.findings), outcome.chosen
        refused[other.model.effect.name, other.trial.joint] = other.model.meaning
    taken = {finding.joint for finding in findings}
    for joint, name in enumerate(scale.names):
        if name not in taken:
            outcome = of_unknown_shape(scale, joint, chosen, layout.shapes, refused)
            findings += outcome.findings
            chosen = outcome.chosen
    final = Selection(chosen, refused, criteria)
    findings += _Findings(final, scale, options).all()
    findings.sort(key=lambda f: f.verdict not in FOUND)
    arm = {effect: reason for (effect, joint), reason in layout.untestable.items()
           if joint is None}
    reports = {name: _report(scale, n, float(noise[n]), chosen, findings, options)
               for n, name in enumerate(scale.names)}
    return Judged(Diagnosis(tuple(findings), reports, arm), chosen)


class _Findings:
    """The findings of chosen effects."""

    def __init__(self, selection: Selection, scale: Scale, options: VerdictOptions) -> None:
        self.selection, self.scale, self.options = selection, scale, options
        self.fits = selection.fits
        self.chosen = _in_order(self.fits, selection.chosen)
        self._widths: dict[int, FloatArray] = {}
        folds = pose_folds(scale.motion.samples, self.fits.blocks)
        self._elsewhere: tuple[Fits, list[Candidate]] | None = None
        if self.chosen and folds is not None:
            self._elsewhere = self.fits.refolded(self.chosen, folds)

    def all(self) -> list[Finding]:
        """Return one finding for each, in the order in which the error falls most."""
        found = [self._finding(place) for place in range(len(self.chosen))]
        return [self._beside_its_parent(finding, candidate, found)
                for finding, candidate in zip(found, self.chosen)]

    def _beside_its_parent(self, finding: Finding, candidate: Candidate,
                           findings: Sequence[Finding]) -> Finding:
        """Return a finding that corrects another effect as weak, if it is open which one."""
        corrects = candidate.effect.corrects
        given = any((name, candidate.joint) in self.selection.criteria.given
                    for name in corrects)
        if finding.verdict not in FOUND or not corrects or given:
            return finding
        parents = [f for f in findings if f.effect in corrects and f.joint == finding.joint]
        if not parents or any(f.verdict in FOUND or set(f.rivals) & set(corrects)
                              for f in parents):
            return finding
        names = ' or '.join(str(f.effect) for f in parents)
        return replace(finding, verdict=Verdict.WEAK,
                       why=f'{finding.why}; it corrects {names}, which is not settled')

    def _finding(self, place: int) -> Finding:
        candidate, scale = self.chosen[place], self.scale
        rest = [c for c in self.chosen if c is not candidate]
        kept = self.selection.criteria.gain_beside(candidate, rest)
        joint = self._most_affected(candidate, rest)
        before, after = (scale.nrmse(c, joint) for c in (self.chosen[:place],
                                                         self.chosen[:place + 1]))
        found = tuple(
            c.effect.name if c.joint == candidate.joint or c.joint is None
            else f'{c.effect.name}:{scale.names[c.joint]}'
            for c in alternatives(self.selection, candidate, self.chosen)
        ) + rest_angles(self.fits, scale.motion, candidate, self.chosen)
        twins = untestable_twins(self.fits, scale.motion, candidate, self.options)
        sizes = estimates(self.fits, self.chosen, scale.motion, candidate,
                          self._half_widths(candidate.place))
        proof = Proof(kept, kept.p < self.selection.criteria.options.alpha,
                      scale.runs_better(kept), before, after,
                      effective_of(self.fits, scale.motion, joint, self.chosen, candidate),
                      found, twins, sizes, candidate.n_free(scale.motion),
                      self.selection.criteria.unphysical(candidate, self.chosen),
                      scale.left(candidate),
                      remainder_of(self.fits, candidate, self.chosen, self.options),
                      self._errors_elsewhere(place))
        level, doubt = verdict(self.fits, self.chosen, candidate, proof, self.options)
        name = None if candidate.joint is None else scale.names[candidate.joint]
        why = evidence_sentence(candidate.effect.title, name or 'the whole arm', before, after,
                                kept.p)
        return Finding(
            name, candidate.effect.name, level, found or twins, sizes, before, after,
            scale.absorbed(candidate), proof.runs_better, f'{why}; {doubt}' if doubt else why,
            _next_step(candidate, name, level), kept.p, dict(candidate.setting))

    def _half_widths(self, joint: int) -> FloatArray:
        if joint not in self._widths:
            self._widths[joint] = half_widths(self.fits, self.chosen, joint, self.scale.motion)
        return self._widths[joint]

    def _errors_elsewhere(self, place: int) -> tuple[FloatArray, FloatArray] | None:
        """Return errors without and with an effect, at poses unlike those of the fit."""
        if self._elsewhere is None:
            return None
        fits, chosen = self._elsewhere
        candidate = chosen[place]
        joint = candidate.acts_on
        rest = [c for c in chosen if c is not candidate]
        return fits.errors(joint, rest), fits.errors(joint, chosen)

    def _most_affected(self, candidate: Candidate, rest: Sequence[Candidate]) -> int:
        """Return the joint on which an effect is judged: its own, or where it helps most."""
        if not candidate.shared:
            return candidate.place
        with_it, = self.fits.errors_with_each(None, rest, [candidate])
        return int(np.argmax((self.fits.errors(None, rest) - with_it).sum(axis=0)))


def _in_order(fits: Fits, chosen: Sequence[Candidate]) -> list[Candidate]:
    """
    Return effects so that each next one takes most off the errors that are left.

    An effect takes less off beside more others, as a rule: only the first of those that are left
    is worked out again.
    """
    ordered: list[Candidate] = []
    gains = {c: float('inf') for c in chosen}
    fresh: set[Candidate] = set()
    while gains:
        best = max(gains, key=lambda c: gains[c])
        if best in fresh:
            ordered.append(best)
            del gains[best]
            # Effects of one joint touch those of another by gravity alone.
            fresh = {c for c in fresh if None not in (c.acts_on, best.acts_on)
                     and c.acts_on != best.acts_on}
        else:
            before = fits.errors(best.acts_on, ordered)
            after, = fits.errors_with_each(best.acts_on, ordered, [best])
            gains[best] = float((before - after).sum())
            fresh.add(best)
    return ordered


def _next_step(candidate: Candidate, name: str | None, level: Verdict) -> str:
    """Return the motion that settles what is open; what is found is to be added."""
    if level in FOUND:
        return ''
    return candidate.effect.experiment.replace('{joint}', name or 'the arm')


def _imitated(scale: Scale, n: int, said: Sequence[Finding],
              least_left: float) -> dict[str, str]:
    """Return why usual effects of a joint would not show that gravity imitates nearly wholly."""
    named, found = {f.effect for f in said}, {}
    for c in reversed(scale.criteria.candidates):
        # The first candidate of a name has the plainest setting.
        if c.acts_on == n and c.effect.expectation == Expectation.COMMON \
                and c.effect.name not in named:
            found[c.effect.name] = scale.left(c)
    return {name: f'gravity can imitate all but {left:.1%} of its torque in this motion'
            for name, left in found.items() if left < least_left}


def _report(scale: Scale, n: int, noise: float, chosen: Sequence[Candidate],
            findings: Sequence[Finding], options: VerdictOptions) -> JointReport:
    fits = scale.criteria.fits
    here = [f for f in findings if f.joint == scale.names[n]]
    untestable = {effect: reason for (effect, joint), reason in fits.layout.untestable.items()
                  if joint == n}
    untestable.update(_imitated(scale, n, here, options.least_left))
    after = fits.errors(n, chosen)
    remaining, share = scale.rmse(after, n), scale.nrmse_of(after, n)
    stays = remaining > _FAR_ABOVE * noise and share > _LEAST_REMAINING
    words = ', '.join(f'{f.effect or "something"} ({f.verdict})' for f in here)
    if stays:
        words = ', '.join(filter(None, [words, (
            f'{remaining:.3g} N·m remain, {share:.1%} of the range of the torque, that nothing '
            f'found here explains')]))
    return JointReport(words or 'nothing missing that this recording could show',
                       noise, effective(fits, scale.motion, n, chosen),
                       scale.rmse(fits.errors(n, []), n), remaining, untestable,
                       share if stays else 0.0)
