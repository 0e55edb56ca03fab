"""A fit with requested effects: found ones are predicted, others are forced into a second fit."""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.request import Request
from gravity_comp_ros.effects.rigid_body import DYNAMICS
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.estimation.estimate import Estimate, estimate, FitOptions
from gravity_comp_ros.estimation.fit import FitResult, key_of, result_of


def requested_fit(samples: JointSamples, requested: Sequence[Request], options: FitOptions,
                  tested: Sequence[Effect]) -> FitResult:
    """
    Return a fit whose model predicts the requested effects.

    :param tested: the effects that may be in the model, the requested ones among them.
    :raises FitError: if there are too few samples.
    :raises DataError: if the samples do not excite a requested effect.
    """
    estimated = estimate(samples, options, effects=tested)
    predicted, is_new = _identified(estimated, requested)
    if is_new:
        keys = frozenset(key_of(name, samples.names) for name in predicted if name != DYNAMICS)
        estimated = estimate(samples, options, forced=keys, effects=tested)
    return result_of(estimated, options, predicted)


def _identified(estimated: Estimate, requested: Sequence[Request]) -> tuple[list[str], bool]:
    """
    Return the requested effects that the samples excite, and whether one is not in the estimate.

    :raises DataError: if a joint was named, and the samples do not excite the effect there.
    """
    regression = estimated.regression
    joints, untestable = regression.problem.samples.names, regression.candidates.untestable
    terms = {term.key for term in regression.terms}
    predicted, is_new = [], False
    for request in requested:
        key = key_of(request.target, joints)
        reason = untestable.get(key)
        if key in terms or reason is None:
            predicted.append(request.target)
            is_new |= key not in terms and request.target != DYNAMICS
        elif request.named:
            raise DataError(f'{request.target} cannot be fitted: {reason}')
    return predicted, is_new
