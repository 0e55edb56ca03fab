"""Targets of a plan: named, open in a diagnosis, or open in a regression."""

from __future__ import annotations

from collections.abc import Iterable

from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.effect import Expectation
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.planning.options import GRAVITY, Target
from gravity_comp_ros.regression.engine import Regression
from gravity_comp_ros.regression.term import Key
import numpy as np

OPEN = ('ambiguous', 'untestable', 'weak')
MAX_TARGETS = 10
# Half-width of a 95 % interval in standard deviations.
_Z95 = 1.96


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
