"""Fit of gravity jointly with effects, so that gravity does not absorb them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, JointSamples
from gravity_comp_ros.effects.request import Request
from gravity_comp_ros.estimation.fast_motion import fit_gravity
from gravity_comp_ros.estimation.fit import FitOptions, FitResult
from gravity_comp_ros.estimation.refit import Progress, refit, RefitOptions
from gravity_comp_ros.estimation.refit_result import Refit
from gravity_comp_ros.models.gravity_model import GravityModel


@dataclass(frozen=True)
class FitWithEffects:
    """
    The fit of gravity alone, and the refit of gravity and effects together.

    The model with effects is that of `joint`; `gravity` is the one without them.
    """

    fit: FitResult
    joint: Refit

    @property
    def gravity(self) -> GravityModel:
        return self.fit.model


def fit_with_effects(samples: JointSamples, slow: JointSamples, effects: Sequence[Request],
                     options: FitOptions = FitOptions(), speeds: RefitOptions = RefitOptions(),
                     use: BoolArray | None = None, progress: Progress | None = None
                     ) -> FitWithEffects:
    """
    Learn gravity and effects.

    A first fit of gravity provides the effects' columns; `refit` then selects gravity again,
    jointly with the effects.

    :param samples: as recorded.
    :param slow: those of them that passed the gate.
    :param use: which samples (M,) may be used for the effects; None for all.
    :raises FitError: if there are too few slow samples.
    :raises DataError: if an effect is not identifiable from the recording.
    """
    first = fit_gravity(slow, options, progress)
    return FitWithEffects(first, refit(samples, first.model, effects, speeds, use, progress))
