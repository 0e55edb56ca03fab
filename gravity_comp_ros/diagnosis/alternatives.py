"""Alternative explanations: effects that explain as much as a chosen one in its place."""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.criteria import Criteria
from gravity_comp_ros.diagnosis.selection import Selection
from gravity_comp_ros.effects.effect import Expectation
from gravity_comp_ros.evaluation.gain import within_standard_error


def alternatives(selection: Selection, candidate: Candidate,
                 chosen: Sequence[Candidate]) -> list[Candidate]:
    """
    Return effects that explain as much as a chosen one, and are no more complex.

    Complexity does not exclude a rare confounder of the same family (a cable for an end stop):
    the number of coefficients does not decide between them. An unphysical size does not exclude
    a common confounder: where gravity is nearly collinear with it, both coefficients grow
    without bound.
    """
    criteria = selection.criteria
    rest = [c for c in chosen if c is not candidate]
    others = [c for c in criteria.replacements(candidate, chosen, ())
              if (c.complexity <= candidate.complexity or _same_kind(c, candidate))
              and c.key != candidate.key
              and (c.key not in selection.refused or _common_confounder(c, candidate))]
    equivalent: dict[tuple[str, int | None], Candidate] = {}
    for other, with_it, with_other in criteria.with_each_replacement(candidate, others, chosen):
        if within_standard_error(with_it, with_other) and (
                _common_confounder(other, candidate)
                or criteria.is_physical(other, [*rest, other])):
            equivalent.setdefault(other.key, other)
    for also in (_spring_with_offset(criteria, candidate, chosen),
                 _viscous_with_warming(criteria, candidate, chosen)):
        if also is not None:
            equivalent.setdefault(also.key, also)
    return list(equivalent.values())


def _same_kind(other: Candidate, candidate: Candidate) -> bool:
    """Return whether both are rare confounders of one family."""
    rare = all(c.effect.expectation == Expectation.RARE for c in (other, candidate))
    return (rare and other.effect.family == candidate.effect.family
            and other.effect.name in candidate.effect.confounders)


def _common_confounder(other: Candidate, candidate: Candidate) -> bool:
    return (other.effect.expectation == Expectation.COMMON
            and other.effect.name in candidate.effect.confounders)


def _viscous_with_warming(criteria: Criteria, candidate: Candidate,
                          chosen: Sequence[Candidate]) -> Candidate | None:
    """
    Return viscous friction as the alternative to a nonlinear friction law, if friction warms up.

    Warm-up between motions of different speed resembles a nonlinear function of the speed.
    """
    joint = candidate.joint
    if not candidate.effect.is_nonlinear_in_speed or not any(
            c.effect.name == 'friction_drift' and c.joint == joint for c in chosen):
        return None
    return next((c for c in criteria.candidates if c.key == ('viscous_friction', joint)), None)


def _spring_with_offset(criteria: Criteria, candidate: Candidate,
                        chosen: Sequence[Candidate]) -> Candidate | None:
    """
    Return the spring that explains as much as a rare effect if its rest angle is free.

    The column of a spring is centred at the mean angle of the motion. An offset in addition to
    it moves the rest angle.
    """
    if (candidate.effect.expectation != Expectation.RARE
            or 'joint_spring' not in candidate.effect.confounders):
        return None
    # The first candidate of a name is the torsion spring without overtones.
    pair = {c.effect.name: c for c in reversed(criteria.candidates) if c.joint == candidate.joint
            and c.effect.name in ('joint_spring', 'torque_offset')}
    spring = pair.get('joint_spring')
    if spring is None or any(c.key == spring.key for c in chosen):
        return None
    rest = [c for c in chosen if c is not candidate and c not in pair.values()]
    with_it, with_spring = (criteria.fits.errors(candidate.acts_on, effects)
                            for effects in (chosen, [*rest, *pair.values()]))
    return spring if within_standard_error(with_it, with_spring) else None
