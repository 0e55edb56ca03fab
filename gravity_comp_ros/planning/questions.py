"""
Targets of a plan and their questions.

A target is an effect on a joint, or on the whole arm: named by the user, or an open finding of a
diagnosis. Its question is its term, the terms of its base, and its alternatives.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.registry import all_effects, known_effect, requests
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.planning.criterion import Question, Terms
from gravity_comp_ros.planning.sums import joined, motion_of, Path, rows_of_planned, Sums
from gravity_comp_ros.regression.candidates import TermFactory
from gravity_comp_ros.regression.engine import Regression
from gravity_comp_ros.regression.term import Key, Term
import numpy as np

OPEN = ('ambiguous', 'untestable', 'weak')
MAX_TARGETS = 10


def named_targets(effects: Iterable[str], joints: tuple[str, ...]) -> list[Key]:
    """
    Return the keys of the targets `NAME` (every joint) and `NAME:JOINT`.

    :raises OptionError: if an effect or joint is unknown or named twice, or if every fit
        estimates the effect.
    """
    named = requests(effects, joints)
    for request in named:
        if request.effect.is_shared:
            raise OptionError(f'every fit estimates {request.target}; name gravity instead')
    return [(request.effect.name, None if request.joint is None else joints.index(request.joint))
            for request in named]


def open_targets(regression: Regression, diagnosis: Diagnosis) -> list[Key]:
    """Return the open findings, then common effects that moving joints do not excite."""
    names, scale = regression.problem.samples.names, regression.problem.scale.torque
    targets: list[Key] = [
        (f.effect, None if f.joint is None else names.index(f.joint))
        for f in diagnosis.findings
        if f.verdict in OPEN and f.effect is not None and f.effect in all_effects()]
    untestable = [(name, joint) for name, joint in regression.candidates.untestable
                  if joint is not None and all_effects()[name].is_common
                  and excitation.travel(regression.motion, joint) > excitation.STILL]
    targets += sorted(untestable, key=lambda key: -float(scale[key[1]]))
    return [key for key in dict.fromkeys(targets) if not all_effects()[key[0]].is_shared]


def questions_of(regression: Regression, targets: Sequence[Key], probe: Path, seconds: float
                 ) -> tuple[Sums, tuple[Question, ...], list[str]]:
    """
    Return the sums of all terms, the questions, and why other targets have none.

    :param probe: a motion that excites the joints of the targets.
    :param seconds: duration of the planned motion.
    :raises OptionError: if no target has a question.
    """
    maker, drafts, notes = _Maker(regression, motion_of(regression, [probe])), [], []
    for key in targets:
        if (term := maker.term(key)) is not None:
            base = maker.base(term)
            drafts.append((term, base, maker.alternatives(term, base)))
        else:
            joint = None if key[1] is None else regression.problem.samples.names[key[1]]
            notes.append(f'{target(key[0], joint)}: no motion within the limits excites it: '
                         f'{maker.reason(key)}')
    if targets and not drafts:
        raise OptionError('; '.join(notes))
    terms = dict.fromkeys([*regression.terms, *(
        t for term, base, others in drafts for t in (*base, term, *others))])
    sums = Sums(regression, tuple(terms), seconds)
    return sums, tuple(Question(*draft, sums) for draft in drafts), notes


class _Maker:
    """Maker of the terms that the recordings and a planned motion together excite."""

    def __init__(self, regression: Regression, planned: Motion) -> None:
        problem, recorded = regression.problem, regression.motion
        self._regression, self._joined = regression, joined(regression, planned)
        self._recorded = TermFactory(lambda: recorded, problem.rows, problem.scale)
        self._planned = TermFactory(lambda: planned, rows_of_planned(regression, planned),
                                    problem.scale)
        self._terms: dict[Key, Term | None] = {term.key: term for term in regression.terms}

    def term(self, key: Key) -> Term | None:
        """
        Return a term of the regression, or an effect at its middle setting if it is excited.

        Its settings are those on the recordings, or on both motions; its prior is that of its
        torque in the recordings or the plan, the smaller one.
        """
        if key not in self._terms:
            effect, joint = known_effect(key[0]), key[1] or 0
            grid = next((grid for motion in (self._recorded.motion, self._joined)
                         if not effect.untestable(motion, joint)
                         and (grid := effect.settings(motion, joint))), [])
            terms = [factory.term(effect, key[1], grid[round(0.5 * (len(grid) - 1))], len(grid))
                     for factory in (self._recorded, self._planned) if grid]
            self._terms[key] = replace(terms[0], prior_std=np.minimum(
                *(term.prior_std for term in terms))) if terms else None
        return self._terms[key]

    def reason(self, key: Key) -> str:
        """Return why an effect without terms is not excited."""
        return known_effect(key[0]).untestable(self._joined, key[1] or 0) or 'it is not reached'

    def base(self, term: Term) -> Terms:
        """
        Return the found terms without target and alternatives, and common effects of its joint.

        The joint may have these although the recordings do not excite them. An effect that a
        target corrects is among them.
        """
        keys = [t.key for t in self._regression.terms]
        if term.joint is not None:
            keys += [(name, term.joint) for name, effect in all_effects().items()
                     if effect.is_common and not effect.is_shared]
        if term.parents and not term.parents & set(keys):
            keys += [(name, term.joint) for name in term.effect.corrects[:1]]
        others = ambiguous_with(self._regression, term.key) | {term.key}
        return tuple(t for key in dict.fromkeys(keys) if key not in others
                     and (t := self.term(key)) is not None)

    def alternatives(self, term: Term, base: Terms) -> Terms:
        """Return the terms that may replace a target: ambiguous ones, and its confounders."""
        known, joint, keys = all_effects(), term.joint, {t.key for t in base}
        near = [(name, joint if known[name].per_joint else None)
                for name in term.effect.confounders if name in known
                and (joint is not None or not known[name].per_joint)]
        others = dict.fromkeys([*sorted(ambiguous_with(self._regression, term.key), key=str),
                                *near])
        return tuple(t for key in others if key not in {*keys, term.key}
                     and not known[key[0]].is_shared and (t := self.term(key)) is not None
                     and (not t.parents or t.parents & keys))


def ambiguous_with(regression: Regression, key: Key) -> set[Key]:
    """Return the terms that the recordings do not separate from one."""
    return {*regression.alternatives.get(key, ()), *(
        one for one, others in regression.alternatives.items() if key in others)}
