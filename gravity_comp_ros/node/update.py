"""Few-sample update: after a payload change, learn the difference to the model in use."""

from __future__ import annotations

from gravity_comp_ros.errors import ModelMismatchError
from gravity_comp_ros.gravity.fit import fit, FitOptions, FitResult
from gravity_comp_ros.gravity.model import Coverage, Expansion, GravityModel
from gravity_comp_ros.samples import JointSamples
import numpy as np


def fit_change(samples: JointSamples, old: GravityModel) -> FitResult:
    """
    Fit tau − old(q), and return `old` plus what was found.

    The change of a model that has an energy is an energy; of any other, a torque per joint.

    A payload adds a few terms to the energy; that difference is sparser than the energy
    itself, so ten seconds of motion tell it, where a fit from nothing needs a minute or more
    (and what the old model knows about poses not seen yet stays).

    :param samples: gated samples of the new payload.
    :raises FitError: as `fit`.
    :raises ModelMismatchError: if the model is of other joints.
    """
    if old.joints != samples.names:
        raise ModelMismatchError(f'the model has joints {", ".join(old.joints)}; the samples '
                                 f'have {", ".join(samples.names)}')
    formulation = 'per_joint' if old.energy is None else 'potential'
    rest = JointSamples(samples.names, samples.t, samples.q, samples.qd,
                        samples.tau - old.predict(samples.q), samples.runs, samples.run_labels)
    found = fit(rest, FitOptions(formulation=formulation))
    coverage = Coverage(np.minimum(old.coverage.q_min, found.model.coverage.q_min),
                        np.maximum(old.coverage.q_max, found.model.coverage.q_max),
                        len(samples), samples.n_runs)
    provenance = {**found.model.provenance, 'change_of': old.coverage.n_samples}
    torques = tuple(add(a, b) for a, b in zip(old.torques, found.model.torques))
    energy = None
    if old.energy is not None and found.model.energy is not None:
        energy = add(old.energy, found.model.energy)
    model = GravityModel(samples.names, formulation, torques, energy, found.model.noise,
                         coverage, provenance)
    return FitResult(model, found.report, found.converged)


def add(a: Expansion, b: Expansion) -> Expansion:
    """Return the sum of two sparse sums over one dictionary."""
    indices, place = np.unique(np.concatenate((a.indices, b.indices)), return_inverse=True)
    weights = np.zeros(len(indices))
    np.add.at(weights, place.reshape(-1), np.concatenate((a.weights, b.weights)))
    return Expansion(indices, weights)
