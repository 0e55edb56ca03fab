"""
Gravity of fast motion: rigid-body dynamics is fitted beside it.

Rows of inertia, one for each joint, are the mass matrix at one pose. Where motion is fast, gravity
bends towards what they lack: over the whole joint range of a simulated iiwa by up to 0.7 N·m,
where it is 0.02 N·m off beside rigid-body dynamics.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.samples import evenly_picked, JointSamples
from gravity_comp_ros.effects.motion import build_motion
from gravity_comp_ros.estimation.effect_fit import fit_with_terms
from gravity_comp_ros.estimation.fit import fit, FitOptions, FitResult, Progress
from gravity_comp_ros.estimation.fit_report import build_report
from gravity_comp_ros.estimation.regression import is_fast
import numpy as np

# Of longer recordings evenly picked samples serve.
_MOST_ROWS = 10000
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
    chain = first.model.chain
    if chain is None or not is_fast(samples):
        return first
    if progress:
        progress('dynamics', 0.0)
    samples = samples.joints(first.model.joints)
    rows = evenly_picked(samples.n_samples, _MOST_ROWS)
    known = None if first.model.geometry is None else first.model.geometry.rotations
    found = fit_with_terms(build_motion(samples, first.model), np.asarray(rows), first.model, (),
                           (), options, known, warm=True)
    if progress:
        progress('dynamics', 1.0)
    if not found.dynamics:
        return first
    choice = replace(found.estimate.choice, why=f'{first.report.choice.why}; {_WHY}',
                     held_out=first.report.choice.held_out)
    report = build_report(found.model, samples, choice, found.estimate.choice.estimate.regression)
    report = replace(report, warnings=tuple(dict.fromkeys((*first.report.warnings,
                                                           *report.warnings))))
    return FitResult(replace(found.model, provenance={
        'options': options.to_json(), 'report': report.to_json()}), report, True)
