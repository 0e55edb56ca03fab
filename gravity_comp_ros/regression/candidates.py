"""Candidate terms of a motion: the effects that it excites, at the settings to compare."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from gravity_comp_ros.effects.effect import Effect, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.regression.prior import Scale
from gravity_comp_ros.regression.rows import Rows
from gravity_comp_ros.regression.term import Key, Term
import numpy as np


@dataclass(frozen=True, eq=False)
class TermFactory:
    """
    Makes terms of effects on a motion.

    `motion_of` returns the motion: its gravity is computed when a term needs it.
    """

    motion_of: Callable[[], Motion]
    rows: Rows
    scale: Scale
    cache: dict[object, Term] = field(default_factory=dict)

    @cached_property
    def motion(self) -> Motion:
        return self.motion_of()

    def term(self, effect: Effect, joint: int | None, setting: Setting,
             n_settings: int = 1) -> Term:
        """
        Return a term.

        :param n_settings: number of settings that are compared, which share the prior odds.
        """
        key = effect, joint, tuple(setting.items()), n_settings
        if key not in self.cache:
            term = self._term(effect, joint, setting, n_settings)
            if effect.uses_gravity:
                return term
            self.cache[key] = term
        return self.cache[key]

    def _term(self, effect: Effect, joint: int | None, setting: Setting,
              n_settings: int) -> Term:
        number = 0 if joint is None else joint
        columns = np.asarray(effect.columns(self.motion, number, setting))
        used = self.rows.used(columns)
        size = np.sqrt([np.vdot(used[..., k], used[..., k]) / used[..., k].size
                        for k in range(used.shape[-1])])
        torque = float(self.scale.torque[number]) if joint is not None else self.scale.largest
        std = np.asarray(effect.prior_std(torque, size))
        return Term(effect, joint, dict(setting), self.rows.mean(columns), std,
                    effect.log_odds - float(np.log(n_settings)))

    def settings(self, effect: Effect, joint: int | None) -> tuple[list[Setting], str]:
        """Return the settings of an effect to compare, and the reason why there are none."""
        number = 0 if joint is None else joint
        reason = effect.untestable(self.motion, number)
        settings: list[Setting] = [] if reason else [*effect.settings(self.motion, number)]
        return settings, '' if settings else reason or 'this motion does not reach it'

    def again(self, term: Term) -> Term:
        """Return a term with its columns computed from this motion."""
        if not term.effect.uses_gravity:
            return term
        return replace(self.term(term.effect, term.joint, term.setting), log_odds=term.log_odds,
                       log_volume=term.log_volume)

    def cell(self, term: Term) -> list[Setting]:
        """Return the settings at the ends of the cell about a term's, one parameter at a time."""
        return [*term.effect.refine(self.motion, term.joint_number, term.setting, 1.0)]

    def neighbours(self, term: Term, step: float) -> list[Term]:
        """Return the same effect at neighbouring settings (`Effect.refine`)."""
        settings = term.effect.refine(self.motion, term.joint_number, term.setting, step)
        return [replace(self.term(term.effect, term.joint, setting), log_odds=term.log_odds)
                for setting in settings]


@dataclass(frozen=True, eq=False)
class Candidates:
    """
    Candidate terms: `of_joint` (N lists) act on one joint, `of_arm` on several.

    `untestable` are the reasons why effects are not among them. `excluded` are those of one joint
    at one setting: they are not selected, but a term that one of them could replace is ambiguous.
    """

    of_joint: tuple[tuple[Term, ...], ...]
    of_arm: tuple[Term, ...]
    untestable: Mapping[Key, str]
    excluded: tuple[Term, ...] = ()


def candidates_of(factory: TermFactory, effects: Sequence[Effect]) -> Candidates:
    """Return the candidate terms of effects on a motion."""
    n = factory.motion.samples.n_joints
    of_joint: list[list[Term]] = [[] for _ in range(n)]
    of_arm: list[Term] = []
    untestable: dict[Key, str] = {}
    excluded: list[Term] = []
    for effect in effects:
        if effect.is_shared:
            continue
        for joint in range(n) if effect.per_joint else (None,):
            number = 0 if joint is None else joint
            settings, reason = factory.settings(effect, joint)
            if reason:
                untestable[effect.name, joint] = reason
            if reason and effect.scope == 'joint':
                excluded += [factory.term(effect, joint, setting)
                             for setting in effect.settings(factory.motion, number)[:1]]
            place = of_joint[number] if effect.scope == 'joint' else of_arm
            place += [factory.term(effect, joint, setting, len(settings))
                      for setting in settings]
    return Candidates(tuple(map(tuple, of_joint)), tuple(of_arm), untestable, tuple(excluded))


def common_terms(factory: TermFactory, effects: Sequence[Effect]) -> tuple[Term, ...]:
    """
    Return the effects of motion that are common in joints, where it excites them, at one setting.

    With them the axes are estimated before terms are selected: a chain that absorbs friction is
    a wrong start. Static effects would absorb gravity.
    """
    terms = []
    for effect in effects:
        if not effect.is_common or effect.is_shared or effect.is_static:
            continue
        for joint in range(factory.motion.samples.n_joints):
            settings, _ = factory.settings(effect, joint)
            if settings:
                terms.append(factory.term(effect, joint, settings[len(settings) // 2],
                                          len(settings)))
    return tuple(terms)
