"""What would explain as much as a chosen effect, in its place."""

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
    Return effects as simple that would explain as much in a chosen one's place.

    A rare effect of the same kind that looks like it (a cable like a stop) need not be as simple:
    which of them it is does not follow from a number of coefficients. Where gravity can imitate an
    effect in this motion, both grow beyond all bounds against each other. So a size that is not
    physical does not rule out what every joint may have.
    """
    criteria = selection.criteria
    rest = [c for c in chosen if c is not candidate]
    others = [c for c in criteria.replacements(candidate, chosen, ())
              if (c.complexity <= candidate.complexity or _is_of_a_kind(c, candidate))
              and c.key != candidate.key
              and (c.key not in selection.refused or _is_usual(c, candidate))]
    found: dict[tuple[str, int | None], Candidate] = {}
    for other, now, then in criteria.with_each_instead(candidate, others, chosen):
        if within_standard_error(now, then) and (_is_usual(other, candidate)
                                                 or criteria.is_physical(other, [*rest, other])):
            found.setdefault(other.key, other)
    for also in (_spring_at_rest(criteria, candidate, chosen),
                 _warmed(criteria, candidate, chosen)):
        if also is not None:
            found.setdefault(also.key, also)
    return list(found.values())


def _is_of_a_kind(other: Candidate, candidate: Candidate) -> bool:
    """Return whether both are rare, of one family, and easily confused."""
    rare = all(c.effect.expectation == Expectation.RARE for c in (other, candidate))
    return (rare and other.effect.family == candidate.effect.family
            and other.effect.name in candidate.effect.confounders)


def _is_usual(other: Candidate, candidate: Candidate) -> bool:
    """Return whether every joint may have the other, and it can look like the candidate."""
    return (other.effect.expectation == Expectation.COMMON
            and other.effect.name in candidate.effect.confounders)


def _warmed(criteria: Criteria, candidate: Candidate,
            chosen: Sequence[Candidate]) -> Candidate | None:
    """
    Return viscous friction in the place of another law of speed, beside friction that warms.

    Grease that gets warmer between motions of different speed looks like a curve of the speed.
    """
    joint = candidate.joint
    if not candidate.effect.bends_with_speed or not any(
            c.effect.name == 'friction_drift' and c.joint == joint for c in chosen):
        return None
    return next((c for c in criteria.candidates if c.key == ('viscous_friction', joint)), None)


def _spring_at_rest(criteria: Criteria, candidate: Candidate,
                    chosen: Sequence[Candidate]) -> Candidate | None:
    """
    Return the spring that explains as much as a rare effect, where it may rest at any angle.

    A spring is described about the mean angle of the motion; its rest is an offset beside it.
    """
    if (candidate.effect.expectation != Expectation.RARE
            or 'joint_spring' not in candidate.effect.confounders):
        return None
    # The first candidate of a name has no further settings: the spring of torsion.
    pair = {c.effect.name: c for c in reversed(criteria.candidates) if c.joint == candidate.joint
            and c.effect.name in ('joint_spring', 'torque_offset')}
    spring = pair.get('joint_spring')
    if spring is None or any(c.key == spring.key for c in chosen):
        return None
    rest = [c for c in chosen if c is not candidate and c not in pair.values()]
    now, then = (criteria.fits.errors(candidate.acts_on, effects)
                 for effects in (chosen, [*rest, *pair.values()]))
    return spring if within_standard_error(now, then) else None
