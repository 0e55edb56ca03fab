"""
Gravity of fast motion: rigid-body dynamics is fitted beside it.

Rows of inertia, one for each joint, are the mass matrix at one pose. Where motion is fast, gravity
bends towards what they lack: over the whole joint range of a simulated iiwa by up to 0.7 N·m,
where it is 0.02 N·m off beside rigid-body dynamics.
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
from gravity_comp_ros.estimation.formulation_choice import OTHER_ARM
from gravity_comp_ros.estimation.regression import is_fast
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

# Of longer recordings evenly picked samples serve.
_MOST_ROWS = 10000
# A potential has so many more terms that it must leave less by this (natural logarithm).
_CLEARLY = 0.26
_WHY = 'rigid-body dynamics was fitted beside it'


def fit_gravity(samples: JointSamples, options: FitOptions = FitOptions(),
                progress: Progress | None = None, qdd: FloatArray | None = None) -> FitResult:
    """
    Learn the gravity torque from samples of any speed.

    A chain that was fitted to fast motion is fitted again, beside rigid-body dynamics. That is a
    nuisance term: the model does not predict it.

    :param samples: slow or fast motion.
    :param progress: called with a word and a share from 0 to 1.
    :param qdd: accelerations (M, N) in rad/s^2 of the samples; None computes them.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises ModelMismatchError: if the options have the axes of other joints.
    """
    first = fit(samples, options, progress, qdd=qdd)
    if not is_fast(samples) or options.formulation not in ('auto', 'chain'):
        return first
    if progress:
        progress('dynamics', 0.0)
    samples, warning = checked_velocity(samples)
    # What rows of inertia lack can make a potential the better choice, or known axes look wrong.
    model = first.model if first.model.chain is not None else fit(
        samples, FitOptions('chain', options.sparse)).model
    found, why, problem = _beside_dynamics(samples, model), first.report.choice.why, ''
    if first.model.chain is None:
        why = 'a potential leaves hardly less'
    if options.geometry is not None and model.geometry is None:
        asked = fit(samples, replace(options, formulation='chain'))
        on_axes = _beside_dynamics(samples, asked.model)
        if ((1.0 - OTHER_ARM) * _noise(on_axes) <= _noise(found)).all():
            found, why = on_axes, 'the known axes explain the torque'
        else:
            problem = first.report.choice.warning
    if progress:
        progress('dynamics', 1.0)
    if not found.dynamics or (first.model.chain is None and np.log(_noise(found)).mean() > np.log(
            _of(first)).mean() + _CLEARLY):
        return first
    choice = replace(found.estimate.choice, why=f'{why}; {_WHY}', warning=problem,
                     held_out=first.report.choice.held_out)
    report = build_report(found.model, samples, choice, choice.estimate.regression, warning,
                          options.geometry)
    return FitResult(replace(found.model, provenance={
        'options': options.to_json(), 'report': report.to_json()}), report, True)


def _beside_dynamics(samples: JointSamples, model: GravityModel) -> EffectFit:
    """Return the chain of a model fitted again, on the same axes if they are known."""
    rows = evenly_picked(samples.n_samples, _MOST_ROWS)
    known = None if model.geometry is None else model.geometry.rotations
    return fit_with_terms(build_motion(samples, model), np.asarray(rows), model, (), (),
                          FitOptions('chain'), known)


def _noise(found: EffectFit) -> FloatArray:
    """Return what a chain and all beside it leave of each joint (N,), N·m."""
    estimate = found.estimate.choice.estimate
    assert isinstance(estimate, ChainEstimate)
    return np.maximum(estimate.fit.noise.absolute, 1e-12)


def _of(result: FitResult) -> FloatArray:
    return np.maximum(list(result.report.noise.values()), 1e-12)
