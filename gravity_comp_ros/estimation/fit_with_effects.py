"""A fit of gravity with effects from the start, so that gravity never imitates them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import BoolArray, JointSamples
from gravity_comp_ros.effects.predict import effect_torque, rows_of
from gravity_comp_ros.effects.request import Request
from gravity_comp_ros.estimation.fit import fit, FitOptions, FitResult
from gravity_comp_ros.estimation.refit import Progress, refit, RefitOptions
from gravity_comp_ros.estimation.refit_result import Refit
from gravity_comp_ros.models.gravity_model import GravityModel

# How many samples count as one while features are chosen. What friction leaves near reversals
# is correlated, and with less caution gravity grows features to imitate it.
_CAUTIOUS = 4.0


@dataclass(frozen=True)
class FitWithEffects:
    """
    The fit of gravity to what the effects leave, and the refit of both together.

    The model with effects is that of `joint`; `gravity` is the one without them.
    """

    fit: FitResult
    joint: Refit

    @property
    def gravity(self) -> GravityModel:
        return self.fit.model


def fit_with_effects(samples: JointSamples, slow: JointSamples, wanted: Sequence[Request],
                     options: FitOptions = FitOptions(), speeds: RefitOptions = RefitOptions(),
                     use: BoolArray | None = None, progress: Progress | None = None
                     ) -> FitWithEffects:
    """
    Learn gravity and effects.

    A first fit serves to tell the effects; what they take is subtracted, and what gravity looks
    like is decided anew from the rest, before both are refitted together.

    :param samples: as recorded. :param slow: those of them that passed the gate.
    :param use: which samples (M,) may be used for the effects; None for all.
    :raises FitError: if there are too few slow samples.
    :raises DataError: if an effect cannot be seen in the recording.
    """
    if options.sparse.inflation is None:
        options = replace(options, sparse=replace(options.sparse, inflation=_CAUTIOUS))
    rough = fit(slow, options, progress).model
    first = refit(samples, rough, wanted, speeds, use, progress)
    taken = effect_torque(first.model, samples)[rows_of(samples, slow)]
    result = fit(replace(slow, tau=slow.tau - taken), options, progress)
    joint = refit(samples, result.model, wanted, speeds, use, progress)
    return FitWithEffects(result, joint)
