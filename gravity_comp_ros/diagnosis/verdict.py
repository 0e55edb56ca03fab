"""From chosen effects to verdicts: how sure, beside which rivals, and what would settle it."""

from __future__ import annotations

from collections.abc import Mapping

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.diagnosis import alternative_models, nonparametric as unknown_torque
from gravity_comp_ros.diagnosis.candidates import Candidate, expectation, MOTION, RARE
from gravity_comp_ros.diagnosis.estimates import all_may_be_nothing, each_may_be_nothing, estimates
from gravity_comp_ros.diagnosis.evidence import absorbed
from gravity_comp_ros.diagnosis.findings import Diagnosis, Estimate, Finding, JointReport
from gravity_comp_ros.diagnosis.selection import Selection
from gravity_comp_ros.effects.effect import Motion
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.evaluation.gain import Gain, gain, gain_in_places
from gravity_comp_ros.models.noise import correlation_time
import numpy as np

# Unknown structure worth a finding takes this share of what is left of the error.
_STRUCTURE_SHARE = 0.05
# Structure sits in the few blocks that pass its angle, which makes its mean uncertain.
_STRUCTURE_ALPHA = 0.05
_REMAINDER_SHARE = 0.3
# A known effect that does this part of what an unknown torque would is the better guess.
_AS_GOOD = 0.8
# Two effects whose columns are this alike on a motion cannot be told apart by it.
_SAME = 0.95
_MOST_RUNS = 0.8


class Judge:
    """
    Turns a finished selection into a diagnosis.

    :param span: (N,) the range of the measured torque in N·m, of which errors are a fraction.
    """

    def __init__(self, selection: Selection, motion: Motion, span: FloatArray) -> None:
        self.selection, self.motion, self.span = selection, motion, span
        self.unknown = selection.columns.of_family(unknown_torque.FAMILY)
        self.other_laws = selection.columns.of_family(alternative_models.FAMILY)
        self.names = motion.samples.names
        self.alpha = selection.options.alpha

    def diagnosis(self) -> Diagnosis:
        """Return findings, the strongest first, and reports of all joints."""
        before = {n: self.selection.errors(n, []) for n in range(len(self.names))}
        chosen = list(self.selection.chosen)
        findings = self._bent()
        bent = {finding.joint for finding in findings}
        for n, name in enumerate(self.names):
            if name not in bent:
                findings += self._unexplained(n)
        for place, candidate in enumerate(chosen):
            if candidate in self.selection.chosen:
                findings.append(self._finding(candidate, chosen[:place]))
        findings.sort(key=lambda f: (f.verdict not in ('established', 'likely'), f.p))
        arm = {effect: reason for (effect, joint), reason
               in self.selection.columns.untestable.items() if joint is None}
        return Diagnosis(tuple(findings), {
            name: self._report(n, before[n], findings) for n, name in enumerate(self.names)}, arm)

    def _bent(self) -> list[Finding]:
        """Return what follows another law than its effect, which is no longer chosen then."""
        found = [bent for c in self.other_laws
                 if (bent := alternative_models.bent(self.selection, c, len(self.other_laws)))]
        if not found:
            return []
        bent = max(found, key=lambda one: one.gain.mean)
        helped = (bent.before - bent.after).sum(axis=0)
        joint, place = int(np.argmax(helped)), bent.candidate.joint or 0
        was_chosen = len(bent.without) < len(self.selection.chosen)
        self.selection.chosen = [c for c in bent.without if c.joint != bent.candidate.joint
                                 or self._pays_beside(c, bent)]
        self.selection.refused[bent.effect, bent.candidate.joint] = bent.words
        before, after = (self._rmse(errors[:, joint], joint) * self._scale(joint)
                         for errors in (bent.before, bent.after))
        return [Finding(
            self.names[place], None, 'unexplained', (bent.effect,) if was_chosen else (), {},
            before, after, 0.0, self._runs_better(bent.gain),
            f'it resembles {bent.effect}, but another law explains {bent.gain.share:.1%} more of '
            f'the held-out error: {bent.words}',
            bent.candidate.effect.experiment.replace('{joint}', self.names[place]),
            bent.gain.p)]

    def _pays_beside(self, candidate: Candidate, bent: alternative_models.Bent) -> bool:
        """Return whether an effect is more than part of what the other law describes."""
        rest = [c for c in bent.without if c is not candidate]
        return self.selection.is_needed(candidate, [*rest, bent.candidate])

    def _unexplained(self, joint: int) -> list[Finding]:
        """Return a finding where bumps explain what effects do not; drop effects that pose."""
        chosen = self.selection.chosen
        shapes = [c for c in self.unknown if c.joint == joint]
        if not shapes:
            return []
        unknown = min(shapes, key=lambda c: float(
            self.selection.errors(joint, [*chosen, c]).sum()))
        posing = [c for c in chosen if c.joint == joint and not c.shared]
        rest = [c for c in chosen if c not in posing]
        none, some = (self.selection.errors(joint, c) for c in (rest, chosen))
        every = self.selection.errors(joint, [*chosen, unknown])
        left = gain_in_places(some, every, len(self.unknown))
        if left.p >= _STRUCTURE_ALPHA or left.share < _STRUCTURE_SHARE:
            return []
        mostly = float((some - every).sum()) > 0.5 * float((none - every).sum())
        if not mostly and left.share < _REMAINDER_SHARE:
            return []
        hint = self._hint(joint, some, float(every.sum()))
        if hint is not None:
            return [hint]
        angle = unknown_torque.largest_angle(
            self.motion.samples.q[:, joint],
            self.selection.coefficients(unknown, [*chosen, unknown]),
            int(unknown.setting['bumps']))
        if mostly:
            self.selection.chosen = rest
        best = tuple(sorted({c.effect.name for c in posing})) if mostly else ()
        why = (f'{left.share:.0%} of the held-out error repeats with the angle of the joint, '
               f'most of it near {angle:.2f} rad, and no effect of the library describes it')
        scale = self._scale(joint)
        return [Finding(
            self.names[joint], None, 'unexplained', best, {},
            self._rmse(some, joint) * scale, self._rmse(every, joint) * scale, 0.0,
            self._runs_better(left), why,
            f'Look at joint {self.names[joint]} near {angle:.2f} rad: a detent, a cable that '
            f'catches, a damaged gear or bearing', left.p, {'angle': angle})]

    def _hint(self, joint: int, now: FloatArray, unexplained: float) -> Finding | None:
        """
        Return the effect, too weak to be sure of, that does what an unknown one would do.

        :param unexplained: the joint's error with an unknown torque of angle and direction.
        """
        chosen = self.selection.chosen
        errors = [(self.selection.errors(joint, [*chosen, c]), c)
                  for c in self.selection.open_on(joint)]
        if not errors:
            return None
        then, best = min(errors, key=lambda pair: float(pair[0].sum()))
        removed = float(now.sum() - then.sum())
        if removed < _AS_GOOD * (float(now.sum()) - unexplained):
            return None
        seen = gain(now, then, self.selection.tests(best))
        before, after = (self._rmse(e, joint) * self._scale(joint) for e in (now, then))
        return Finding(
            self.names[joint], best.effect.name, 'weak', (), {}, before, after,
            self._absorbed(best), self._runs_better(seen),
            self._why(best, seen, before, after, ()), self._next_step(best, 'weak'), seen.p,
            dict(best.setting))

    def _scale(self, joint: int) -> float:
        """Return what turns an RMSE in N·m into a fraction of the torque's range."""
        return 1.0 / max(float(self.span[joint]), 1e-9)

    def _rmse(self, errors: FloatArray, joint: int) -> float:
        """Return the RMSE in N·m of block errors."""
        total = max(float(errors.sum()), 0.0)
        return float(np.sqrt(total / self.motion.samples.n_samples)
                     * self.selection.grams[joint].sigma)

    def _finding(self, candidate: Candidate, earlier: list[Candidate]) -> Finding:
        chosen = self.selection.chosen
        rest = [c for c in chosen if c is not candidate]
        scope = None if candidate.shared else candidate.joint
        kept = self.selection.gain_of(candidate, self.selection.errors(scope, rest),
                                      self.selection.errors(scope, chosen))
        earlier = [c for c in earlier if c in chosen]
        joint = self._most_affected(candidate, rest)
        before, after = (self._rmse(self.selection.errors(joint, c), joint)
                         * self._scale(joint) for c in (earlier, [*earlier, candidate]))
        rivals = tuple(c.effect.name if c.joint == candidate.joint or c.joint is None
                       else f'{c.effect.name}:{self.names[c.joint]}'
                       for c in self.selection.rivals(candidate))
        blind = self._untestable_twins(candidate)
        sizes = estimates(self.selection, self.motion, candidate)
        verdict = self._verdict(candidate, kept, rivals, blind, sizes)
        return Finding(
            self._name(candidate), candidate.effect.name, verdict, rivals or blind,
            sizes, before, after, self._absorbed(candidate),
            self._runs_better(kept), self._why(candidate, kept, before, after, blind),
            self._next_step(candidate, verdict), kept.p, dict(candidate.setting))

    def _verdict(self, candidate: Candidate, kept: Gain, rivals: tuple[str, ...],
                 blind: tuple[str, ...], sizes: Mapping[str, Estimate]) -> str:
        if blind:
            return 'untestable'
        if rivals:
            return 'ambiguous'
        if each_may_be_nothing(sizes):
            there = (candidate.expectation == MOTION and len(sizes) > 1
                     and not all_may_be_nothing(self.selection, candidate))
            return 'likely' if there else 'weak'
        joint = candidate.joint or 0
        fit = self.selection.fit(joint, self.selection.chosen)
        here = np.isin(fit.columns, candidate.columns)
        signs = np.sign(fit.without[:, here][:, 0])
        stable = bool((signs == np.sign(fit.all_data[here][0])).all())
        sure = stable and self._runs_better(kept) >= _MOST_RUNS
        return 'established' if sure and kept.p < self.alpha else 'likely'

    def _untestable_twins(self, candidate: Candidate) -> tuple[str, ...]:
        """Return confounders that this motion cannot tell from the effect."""
        if candidate.shared or candidate.joint is None:
            return ()
        known, twins = all_effects(), []
        mine = candidate.effect.columns(self.motion, candidate.joint, candidate.setting)
        for name in candidate.effect.confounders:
            other = known.get(name)
            if other is None or other.scope != 'joint':
                continue
            # A rarer effect that looks the same does not make a common one doubtful.
            if candidate.expectation != RARE and expectation(other) == RARE:
                continue
            if (name, candidate.joint) not in self.selection.columns.untestable:
                continue
            settings = other.settings(self.motion, candidate.joint) or [{}]
            try:
                columns = other.columns(self.motion, candidate.joint, settings[0])
            except (KeyError, ValueError):
                continue
            if _alike(mine, columns) > _SAME:
                twins.append(name)
        return tuple(twins)

    def _absorbed(self, candidate: Candidate) -> float:
        base = np.arange(self.selection.columns.n_base)
        return absorbed(self.selection.grams[candidate.joint or 0], base, candidate.columns)

    def _most_affected(self, candidate: Candidate, rest: list[Candidate]) -> int:
        """Return the joint on which an effect is judged: its own, or where it helps most."""
        if not candidate.shared:
            return candidate.joint or 0
        helped = [float((self.selection.errors(n, rest)
                         - self.selection.errors(n, [*rest, candidate])).sum())
                  for n in range(len(self.names))]
        return int(np.argmax(helped))

    def _runs_better(self, kept: Gain) -> float:
        run = self.selection.blocks.run
        return float(np.mean([kept.blocks[run == r].sum() > 0.0 for r in np.unique(run)]))

    def _name(self, candidate: Candidate) -> str | None:
        return None if candidate.joint is None else self.names[candidate.joint]

    def _why(self, candidate: Candidate, kept: Gain, before: float, after: float,
             blind: tuple[str, ...]) -> str:
        where = self._name(candidate) or 'the whole arm'
        text = (f'{candidate.effect.title} on {where}: held-out error {before:.2%} to '
                f'{after:.2%} of the range, p = {kept.p:.1e} after all that was tried')
        if blind:
            text += f'; this motion cannot tell it from {", ".join(blind)}'
        return text

    def _next_step(self, candidate: Candidate, verdict: str) -> str:
        name = self._name(candidate)
        if verdict in ('ambiguous', 'untestable', 'weak'):
            return candidate.effect.experiment.replace('{joint}', name or 'the arm')
        target = candidate.effect.name + (f':{name}' if name else '')
        return f'gravity_comp add {target} --model MODEL.json BAG...'

    def _report(self, n: int, before: FloatArray, findings: list[Finding]) -> JointReport:
        after = self.selection.errors(n, self.selection.chosen)
        here = [f for f in findings if f.joint == self.names[n]]
        samples = self.motion.samples
        step = max(1, samples.n_samples // 4000)
        residual = self.motion.samples.tau[:, n] - self.motion.gravity[:, n]
        time = correlation_time(residual[::step], samples.runs[::step]) * step
        untestable = {effect: reason for (effect, joint), reason
                      in self.selection.columns.untestable.items() if joint == n}
        words = ', '.join(f'{f.effect or "something"} ({f.verdict})' for f in here)
        return JointReport(words or 'nothing missing that this recording could show',
                           _white_noise(samples, n), samples.n_samples / time,
                           self._rmse(before, n), self._rmse(after, n), untestable)


def _white_noise(samples: JointSamples, joint: int) -> float:
    """Return the standard deviation of what changes from sample to sample (2nd difference)."""
    changes = np.diff(samples.tau[:, joint], 2)
    changes = changes[samples.runs[2:] == samples.runs[:-2]]
    return float(np.std(changes) / np.sqrt(6.0)) if len(changes) > 1 else 0.0


def _alike(a: FloatArray, b: FloatArray) -> float:
    """Return which share of columns b (M, K) the columns a imitate, means left in."""
    basis, _ = np.linalg.qr(a)
    total = float((b ** 2).sum())
    return float(((basis.T @ b) ** 2).sum() / total) if total > 0.0 else 0.0
