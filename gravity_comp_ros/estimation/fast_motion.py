"""
Fit of gravity to fast motion, jointly with rigid-body dynamics.

Inertia as a nuisance term has constant coefficients: the mass matrix at one pose. In fast motion
gravity absorbs part of the remaining torque. Over the whole joint range of a simulated iiwa this
error is up to 0.7 N·m; with rigid-body dynamics it is 0.02 N·m.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.data.velocity_check import checked_velocity
from gravity_comp_ros.effects.motion import build_motion
from gravity_comp_ros.estimation.chain_estimate import ChainEstimate
from gravity_comp_ros.estimation.effect_fit import EffectFit, fit_with_terms
from gravity_comp_ros.estimation.fit import fit, FitOptions, FitResult, Progress
from gravity_comp_ros.estimation.fit_report import build_report
from gravity_comp_ros.estimation.formulation_choice import MIN_GAIN_OF_FREE_AXES
from gravity_comp_ros.estimation.inertia import is_fast
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

# Maximum number of samples that are fitted, evenly picked.
_MAX_ROWS = 10000
# Minimum difference of the mean log noise by which a potential must beat a chain; it has far
# more terms.
_MIN_LOG_GAIN = 0.26
_WHY = 'rigid-body dynamics was a nuisance term'


def fit_gravity(samples: JointSamples, options: FitOptions = FitOptions(),
                progress: Progress | None = None) -> FitResult:
    """
    Learn the gravity torque from samples of any speed.

    A chain is fitted to fast motion a second time, jointly with rigid-body dynamics as a nuisance
    term; the model does not predict this term.

    :param samples: slow or fast motion.
    :param progress: called with a word and a share from 0 to 1.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises ModelMismatchError: if the options have the axes of other joints.
    """
    first = fit(samples, options, progress)
    if not is_fast(samples) or options.formulation not in ('auto', 'chain'):
        return first
    if progress:
        progress('dynamics', 0.0)
    samples, warning = checked_velocity(samples)
    # Without rigid-body dynamics the first fit may prefer a potential or reject known axes.
    model = first.model if first.model.chain is not None else fit(
        samples, FitOptions('chain', options.sparse)).model
    result, why, problem = _with_dynamics(samples, model), first.report.choice.why, ''
    if first.model.chain is None:
        why = 'the residual of a potential is hardly smaller'
    if options.geometry is not None and model.geometry is None:
        on_axes = _with_dynamics(samples, fit(samples, replace(options,
                                                               formulation='chain')).model)
        if ((1.0 - MIN_GAIN_OF_FREE_AXES) * _noise(on_axes) <= _noise(result)).all():
            result, why = on_axes, 'the known axes explain the torque'
        else:
            problem = first.report.choice.warning
    if progress:
        progress('dynamics', 1.0)
    first_noise = np.maximum(list(first.report.noise.values()), 1e-12)
    if not result.dynamics or (first.model.chain is None and np.log(_noise(result)).mean()
                               > np.log(first_noise).mean() + _MIN_LOG_GAIN):
        return first
    choice = replace(result.estimate.choice, why=f'{why}; {_WHY}', warning=problem,
                     held_out=first.report.choice.held_out)
    report = build_report(result.model, samples, choice, choice.estimate.regression, warning,
                          options.geometry)
    return FitResult(replace(result.model, provenance={
        'options': options.to_json(), 'report': report.to_json()}), report, True)


def _with_dynamics(samples: JointSamples, model: GravityModel) -> EffectFit:
    """Return the chain of a model fitted again, on the same axes if they are known."""
    rows = evenly_picked(samples.n_samples, _MAX_ROWS)
    known = None if model.geometry is None else model.geometry.rotations
    return fit_with_terms(build_motion(samples, model), rows, model, (), (),
                          FitOptions('chain'), known)


def _noise(result: EffectFit) -> FloatArray:
    """Return the noise (N,) in N·m of a chain jointly fitted with all terms."""
    estimate = result.estimate.choice.estimate
    assert isinstance(estimate, ChainEstimate)
    return np.maximum(estimate.fit.noise.absolute, 1e-12)
