"""
Nonlinear parameters that the terms of a joint have in common.

The friction effects of a joint contain one direction of motion, so its law is the same in all of
them (`Effect.common`). A term that is added to others has theirs, and a change changes all.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from gravity_comp_ros.regression.candidates import Candidates, TermFactory
from gravity_comp_ros.regression.design import Design, Pool
from gravity_comp_ros.regression.gains import gain_together
from gravity_comp_ros.regression.posterior import Posterior
from gravity_comp_ros.regression.refinement import climbed
from gravity_comp_ros.regression.term import Term

Common = dict[str, float]


def common_of(terms: Iterable[Term], joint: int | None) -> Common:
    """Return the parameters that the terms of a joint have in common; none if none has any."""
    return next((term.common for term in terms if term.joint == joint and term.common), {})


def with_common(factory: TermFactory, term: Term, common: Common) -> Term:
    """Return a term with other common parameters, if both have any."""
    if not common or not term.common or term.common == common:
        return term
    own = {name: value for name, value in term.setting.items() if name not in term.common}
    return replace(factory.term(term.effect, term.joint, {**own, **common}),
                   log_odds=term.log_odds, log_volume=term.log_volume)


@dataclass(frozen=True, eq=False)
class CommonSettings:
    """Candidates and terms at the common parameters of a joint."""

    design: Design
    candidates: Candidates
    factory: TermFactory
    _pools: dict[object, Pool] = field(default_factory=dict)

    def pool(self, joint: int, common: Common) -> Pool:
        """Return the candidates of a joint that have common parameters, at these."""
        key = joint, tuple(common.items())
        if key not in self._pools:
            terms: dict[object, Term] = {}
            for term in self.candidates.of_joint[joint]:
                if term.common:
                    at = self.at(term, common)
                    terms.setdefault((at.key, tuple(at.setting.items())), at)
            self._pools[key] = Pool(self.design, [joint], tuple(terms.values()))
        return self._pools[key]

    def at(self, term: Term, common: Common) -> Term:
        """Return a term with other common parameters, if it has any."""
        return with_common(self.factory, term, common)

    def neighbours(self, term: Term, step: float) -> list[Common]:
        """Return the neighbours of the common parameters of a term."""
        settings = term.effect.refine(self.factory.motion, term.joint_number, term.setting, step)
        near = [{name: setting[name] for name in term.common} for setting in settings]
        return [common for common in near if common != term.common]

    def refined(self, posterior: Posterior, terms: Sequence[Term], halvings: int) -> list[Term]:
        """
        Return terms of a joint at the best common parameters near theirs.

        :param posterior: with coefficients of 0 for these terms.
        """
        def near(present: list[Term], step: float) -> list[tuple[float, list[Term]]]:
            tried = [[self.at(term, common) for term in present]
                     for common in self.neighbours(present[0], step)]
            return [(gain_together(posterior, each), each) for each in tried]

        return climbed(list(terms), gain_together(posterior, terms), near, halvings)[1]
