"""
Gravity of fast motion: rigid-body dynamics is fitted beside it.

Rows of inertia, one for each joint, are the mass matrix at one pose. Where motion is fast, gravity
bends towards what they lack: over the whole joint range of a simulated iiwa by up to 0.7 N·m,
where it is 0.02 N·m off beside rigid-body dynamics.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.samples import evenly_picked, JointSamples
from gravity_comp_ros.data.velocity_check import checked_velocity
from gravity_comp_ros.effects.motion import build_motion
from gravity_comp_ros.estimation.effect_fit import fit_with_terms
from gravity_comp_ros.estimation.fit import fit, FitOptions, FitResult, Progress
from gravity_comp_ros.estimation.fit_report import build_report, FitDetails
from gravity_comp_ros.estimation.regression import is_fast
import numpy as np

# Of longer recordings evenly picked samples serve.
_MOST_ROWS = 10000
# A potential has so many more terms that it must leave less by this (natural logarithm).
_CLEARLY = 0.26
_WHY = 'rigid-body dynamics was fitted beside it'


def fit_gravity(samples: JointSamples, options: FitOptions = FitOptions(),
                progress: Progress | None = None) -> FitResult:
    """
    Learn the gravity torque from samples of any speed.

    A chain that was fitted to fast motion is fitted again, beside rigid-body dynamics. That is a
    nuisance term: the model does not predict it.

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
    rows = evenly_picked(samples.n_samples, _MOST_ROWS)
    # What rows of inertia lack can make a potential the better choice: the chain is tried anyway.
    model = first.model if first.model.chain is not None else fit(
        samples, FitOptions('chain', options.sparse)).model
    known = None if model.geometry is None else model.geometry.rotations
    found = fit_with_terms(build_motion(samples, model), np.asarray(rows), model, (), (),
                           FitOptions('chain', options.sparse), known)
    if progress:
        progress('dynamics', 1.0)
    if not found.dynamics:
        return first
    before = first.report.choice
    why = before.why if first.model.chain is not None else 'a potential leaves hardly less'
    choice = replace(found.estimate.choice, why=f'{why}; {_WHY}', held_out=before.held_out,
                     warning=before.warning)
    report = build_report(found.model, samples, choice, choice.estimate.regression, warning)
    if first.model.chain is None and _left(report) > _left(first.report) + _CLEARLY:
        return first
    return FitResult(replace(found.model, provenance={
        'options': options.to_json(), 'report': report.to_json()}), report, True)


def _left(report: FitDetails) -> float:
    """Return the mean logarithm of what the fit leaves of each joint: each in its own units."""
    return float(np.log(np.maximum(list(report.noise.values()), 1e-12)).mean())
