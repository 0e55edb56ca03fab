"""
Targets of a plan and their questions.

A target is named by the user, or open in a diagnosis or a regression. Its question is its term,
the terms of its base, and its alternatives.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.effect import Effect, Expectation, Setting, Sizes
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.effects.request import known_effect, requests
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.planning.criterion import coefficients, Question
from gravity_comp_ros.planning.options import GRAVITY, Target
from gravity_comp_ros.planning.sums import Path, PlannedMotion, Sums
from gravity_comp_ros.regression.candidates import TermFactory
from gravity_comp_ros.regression.engine import Regression
from gravity_comp_ros.regression.term import Key, Term
import numpy as np

OPEN = ('ambiguous', 'untestable', 'weak')
MAX_TARGETS = 10
# Half-width of a 95 % interval in standard deviations.
_Z95 = 1.96
# Places in the grid of an effect of the settings that are compared; the first is the target's.
_PLACES = (0.2, 0.8)


def named_targets(effects: Iterable[str], joints: tuple[str, ...]) -> list[Target]:
    """
    Return the targets `NAME` (every joint), `NAME:JOINT` and `gravity`.

    :raises OptionError: if an effect or joint is unknown, or named twice.
    """
    names = list(effects)
    targets = [Target(request.effect.name, request.joint) for request in requests(
        [name for name in names if name != GRAVITY], joints)]
    return [*targets, Target(GRAVITY, None)] if GRAVITY in names else targets


def open_targets(regression: Regression, diagnosis: Diagnosis | None = None) -> list[Target]:
    """
    Return the open findings, then common effects that moving joints do not excite.

    Without a diagnosis a term of the regression is open if it is ambiguous, or if no coefficient
    differs from 0.
    """
    candidates = _open_terms(regression) if diagnosis is None else [
        Target(f.effect, f.joint, f.rivals) for f in diagnosis.findings
        if f.verdict in OPEN and f.effect in all_effects()]
    names, scale = regression.problem.samples.names, regression.problem.scale.torque
    untestable = [(name, joint) for name, joint in regression.candidates.untestable
                  if joint is not None and all_effects()[name].expectation is Expectation.COMMON
                  and excitation.travel(regression.motion, joint) > excitation.STILL]
    untestable.sort(key=lambda key: -float(scale[key[1] or 0]))
    candidates += [Target(name, names[joint]) for name, joint in untestable if joint is not None]
    once: dict[str, Target] = {}
    for target in candidates:
        if not all_effects()[target.effect].is_shared:
            once.setdefault(target.name, target)
    return list(once.values())[:MAX_TARGETS]


def _open_terms(regression: Regression) -> list[Target]:
    posterior, limit = regression.posterior, regression.problem.options.min_identified
    terms = []
    for term in regression.terms:
        mean, std = posterior.beta[posterior.at[term]], regression.stds[term.key]
        uncertain = bool((np.abs(mean) < _Z95 * std).all())
        others = regression.alternatives[term.key]
        if others or uncertain or regression.identified[term.key].max() < limit:
            terms.append(_target(regression, term.key, others))
    return terms


def _target(regression: Regression, key: Key, others: Iterable[Key]) -> Target:
    names = regression.problem.samples.names
    joint = None if key[1] is None else names[key[1]]
    return Target(key[0], joint, tuple(
        name if where is None or where == key[1] else f'{name}:{names[where]}'
        for name, where in others))


def questions_of(planned: PlannedMotion, targets: Sequence[Target], probe: Path, seconds: float,
                 diagnosis: Diagnosis | None) -> tuple[Sums, list[Question], list[str]]:
    """
    Return the sums of all terms, the questions, and why other targets have none.

    :param probe: a motion that excites the joints of the targets.
    :param seconds: duration of the planned motion.
    :raises OptionError: if an effect or joint is unknown, or no target has a question.
    """
    maker = _Maker(planned, probe, diagnosis)
    drafts, notes = [], []
    for target in targets:
        try:
            drafts.append(maker.question(target))
        except _NotExcitedError as problem:
            notes.append(str(problem))
    if targets and not drafts:
        raise OptionError('plan: ' + '; '.join(notes))
    terms = dict.fromkeys([*planned.regression.terms, *(
        t for q in drafts for t in (*q.base, q.term, *q.alternatives))])
    sums = Sums(planned, tuple(terms), seconds)
    return sums, [_measured(sums, question) for question in drafts], notes


class _NotExcitedError(OptionError):
    """No motion within the limits excites an effect."""


def _measured(sums: Sums, question: Question) -> Question:
    """Return a question with the size of the present estimate, if the recordings have one."""
    regression, term = sums.planned.regression, question.term
    if term.key in regression.candidates.untestable:
        return question
    places = sums.with_shared((*question.base, term))
    mean, covariance = coefficients(sums, places, sums.recorded, sums.score)
    mean, covariance = mean[-term.n_columns:], covariance[-term.n_columns:, -term.n_columns:]
    # Log of the ratio of the densities at 0 of prior and posterior (Savage-Dickey).
    gain = 0.5 * float(mean @ np.linalg.solve(covariance, mean)) + 0.5 * float(
        np.linalg.slogdet(covariance)[1]) - float(np.log(term.prior_std).sum()) + term.log_odds
    if gain < regression.problem.options.min_gain:
        return question
    return replace(question, mean=mean, moment=np.outer(mean, mean) + covariance,
                   is_measured=True)


@dataclass(frozen=True, eq=False)
class _Maker:
    planned: PlannedMotion
    probe: Path
    diagnosis: Diagnosis | None
    memo: dict[tuple[Key, bool], list[Term]] = field(default_factory=dict)

    @property
    def regression(self) -> Regression:
        return self.planned.regression

    @cached_property
    def _probe(self) -> Motion:
        return self.planned.of([self.probe])

    @cached_property
    def _joined(self) -> Motion:
        return self.planned.joined(self.probe)

    @cached_property
    def _factory(self) -> TermFactory:
        problem = self.regression.problem
        return TermFactory(lambda: self.regression.motion, problem.rows, problem.scale)

    def question(self, target: Target) -> Question:
        """Return the question of a target, its size from the prior."""
        effect = known_effect(target.effect)
        if effect.is_shared:
            raise OptionError(f'plan: every fit estimates {effect.name}; name gravity instead')
        key = effect.name, self._joint(effect, target.joint)
        term = self._terms(key, self._setting_found(target))[0]
        named = {self._key(text, key[1]) for text in target.alternatives}
        named |= set(self.regression.alternatives.get(key, ()))
        named |= {one for one, others in self.regression.alternatives.items()
                  if key in others}
        base = self._base(term, named)
        keys = {t.key for t in base}
        others = [t for other in self._others(effect, key, named) if other not in keys
                  for t in self._possible(other)
                  if not t.parents or t.parents & keys]
        size = np.diag(term.prior_std ** 2)
        return Question(target, term, base, tuple(others), np.zeros(len(size)), size, False)

    def _base(self, term: Term, named: set[Key]) -> tuple[Term, ...]:
        """
        Return the found terms without target and alternatives, and common effects of its joint.

        The joint may have these although the recordings do not excite them. An effect that a
        target corrects is among them.
        """
        base = [t for t in self.regression.terms if t.key != term.key and t.key not in named]
        common: list[Key] = [(name, term.joint) for name, effect in all_effects().items()
                             if effect.expectation is Expectation.COMMON and not effect.is_shared]
        if term.joint is None:
            common = []
        keys = {t.key for t in base}
        if term.parents and not term.parents & {*keys, *common}:
            common += [(name, term.joint) for name in term.effect.corrects[:1]]
        for key in common:
            if key not in {*keys, *named, term.key}:
                base += self._possible(key)[:1]
        return tuple(base)

    def _others(self, effect: Effect, key: Key, named: set[Key]) -> list[Key]:
        """Return the alternatives: named ones, and the confounders of the effect."""
        known = all_effects()
        near = [(name, key[1] if known[name].per_joint else None) for name in effect.confounders
                if name in known and (key[1] is not None or not known[name].per_joint)]
        return [other for other in dict.fromkeys([*sorted(named, key=str), *near])
                if other != key and not known[other[0]].is_shared]

    def _possible(self, key: Key) -> list[Term]:
        """Return an effect at some of its settings; none if no motion excites it."""
        try:
            return self._terms(key, {})
        except _NotExcitedError:
            return []

    def _terms(self, key: Key, setting: Setting) -> list[Term]:
        """
        Return a term of the regression, or an effect at a given setting or some of its own.

        :raises _NotExcitedError: if no motion within the limits excites it.
        """
        present = [t for t in self.regression.terms if t.key == key]
        if present:
            return present
        if (key, not setting) not in self.memo:
            grid = self._settings(key)
            picked = dict.fromkeys(round(place * (len(grid) - 1)) for place in _PLACES)
            chosen = [setting] if setting else [grid[k] for k in picked]
            self.memo[key, not setting] = [
                self._term(known_effect(key[0]), key[1], each, len(grid)) for each in chosen]
        return self.memo[key, not setting]

    def _settings(self, key: Key) -> list[dict[str, float]]:
        effect, number, reason = known_effect(key[0]), key[1] or 0, ''
        for motion in (self.regression.motion, self._joined):
            reason = effect.untestable(motion, number) or ''
            grid = [] if reason else effect.settings(motion, number)
            if grid:
                return grid
        raise _NotExcitedError(f'{_name(key, self._names)}: no motion within the limits excites '
                               f'it: {reason or "it is not reached"}')

    def _term(self, effect: Effect, joint: int | None, setting: Setting, count: int) -> Term:
        """Return a term whose prior is that of its torque in the recordings or the probe."""
        term, scale = self._factory.term(effect, joint, setting, count), self._factory.scale
        columns = np.asarray(effect.columns(self._probe, joint or 0, setting))
        size = np.sqrt((columns ** 2).mean(axis=tuple(range(columns.ndim - 1))))
        torque = scale.largest if joint is None else float(scale.torque[joint])
        std = effect.prior_std(Sizes(torque, size))
        return replace(term, prior_std=np.minimum(term.prior_std, std))

    def _setting_found(self, target: Target) -> Mapping[str, float]:
        """Return the setting of the finding of a target, empty without one."""
        finding = self.diagnosis and self.diagnosis.finding(target.effect, target.joint)
        return finding.setting if finding else {}

    @property
    def _names(self) -> tuple[str, ...]:
        return self.regression.problem.samples.names

    def _key(self, text: str, joint: int | None) -> Key:
        """Return the key of an alternative, NAME or NAME:JOINT."""
        name, _, where = text.partition(':')
        if not known_effect(name).per_joint:
            return name, None
        return name, self._names.index(where) if where in self._names else joint

    def _joint(self, effect: Effect, name: str | None) -> int | None:
        if not effect.per_joint:
            return None
        if name is None:
            raise OptionError(f'{effect.name} is an effect of one joint: name it '
                              f'({effect.name}:JOINT)')
        if name not in self._names:
            raise OptionError(f'no joint {name}; the joints are {", ".join(self._names)}')
        return self._names.index(name)


def _name(key: Key, names: Sequence[str]) -> str:
    return key[0] if key[1] is None else f'{key[0]}:{names[key[1]]}'
