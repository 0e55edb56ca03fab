"""
Few-sample update: a model after a tool change, from the model before it and seconds of motion.

A tool changes few of the numbers that a model consists of: some moments of a chain, some weights
of an energy. What the old model knew about all others stays, with its uncertainty (`change`).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from gravity_comp_ros.errors import FitError, ModelMismatchError, OptionError
from gravity_comp_ros.gravity import noise
from gravity_comp_ros.gravity.chain_expand import expand
from gravity_comp_ros.gravity.chain_update import NewSamples, update_chain
from gravity_comp_ros.gravity.change import average_change, Change, ChangeProblem
from gravity_comp_ros.gravity.design import EnergyDesign
from gravity_comp_ros.gravity.dictionary import feature_name
from gravity_comp_ros.gravity.model import Coverage, Expansion, GravityModel
from gravity_comp_ros.gravity.uncertainty import ChainUncertainty, EnergyUncertainty
from gravity_comp_ros.samples import FloatArray, JointSamples
import numpy as np

# Shorter correlation times than this are what chance makes of white noise.
_WHITE = 2.0
# Noise that the new samples show to differ by no more changes no weights that matter.
_SAME_NOISE = 0.15


@dataclass(frozen=True)
class UpdateOptions:
    """
    How an update is made.

    `min_samples` are asked for at least; `old_noise` is how many samples the noise of the old
    model's training counts for beside that of the new ones.

    :raises OptionError: if a value is out of range.
    """

    min_samples: int = 10
    old_noise: float = 50.0

    def __post_init__(self) -> None:
        if self.min_samples < 2:
            raise OptionError(f'update: min_samples is {self.min_samples}; it must be 2 or more')
        if not 0.0 < self.old_noise < np.inf:
            raise OptionError(f'update: old_noise is {self.old_noise}; it must be positive')


@dataclass(frozen=True)
class UpdateResult:
    """The model with the new tool, and a report ready for JSON."""

    model: GravityModel
    report: dict[str, Any]


def update(model: GravityModel, samples: JointSamples,
           options: UpdateOptions = UpdateOptions()) -> UpdateResult:
    """
    Return the model that explains `samples`, taken after a tool change, by a sparse change.

    :param model: of the chain or the potential formulation.
    :param samples: gated; joints are matched by name. Fifty (10 s at 5 Hz) are a good number.
        Their torque is gravity: what the effects of the model do must have been taken off.
    :raises ModelMismatchError: if the samples lack a joint, or the model is per_joint.
    :raises FitError: if there are too few samples.
    """
    samples = samples.joints(model.joints)
    if samples.n_samples < options.min_samples:
        raise FitError(f'{samples.n_samples} slow samples since the tool changed; an update needs '
                       f'{options.min_samples}. Move on slowly')
    if model.energy is None:
        raise ModelMismatchError('a per_joint model has no energy whose change a tool would be; '
                                 'fit it again, or keep a chain or potential model')
    step = _chain_step if model.chain is not None else _energy_step
    sigma = np.maximum(model.noise, noise.floor(samples.tau))
    found = step(model, samples, sigma)
    old_sigma, sigma = sigma, _noise(found.model, samples, sigma, options)
    if not np.allclose(sigma, old_sigma, rtol=_SAME_NOISE):
        found = step(model, samples, sigma)
    residual = samples.tau - found.model.predict(samples.q)
    rmse = np.sqrt((residual ** 2).mean(axis=0))
    report = _report(model, found, samples, rmse, sigma)
    provenance = {**model.provenance,
                  'updates': [*model.provenance.get('updates', []), report]}
    updated = replace(found.model, noise=sigma, coverage=_coverage(model, samples),
                      provenance=provenance)
    return UpdateResult(updated, report)


@dataclass(frozen=True)
class _Step:
    """A changed model, what changed by name and in N·m, and how it was found."""

    model: GravityModel
    changed: dict[str, float]
    change: Change


def _chain_step(model: GravityModel, samples: JointSamples, sigma: FloatArray) -> _Step:
    assert model.chain is not None
    n = model.n_joints
    covariance = np.zeros((4 * n, 4 * n)) if model.uncertainty is None \
        else model.uncertainty.covariance
    found = update_chain(model.chain, covariance, NewSamples(samples.q, samples.tau, sigma))
    changed = {f'{model.joints[k // 2]} {"xy"[k % 2]}':
               float((found.chain.moments - model.chain.moments).ravel()[k])
               for k in found.change.support - 2 * n}
    energy = expand(found.chain)
    return _Step(_with_energy(model, energy, found.chain,
                              ChainUncertainty(found.chain, found.covariance)),
                 changed, found.change)


def _energy_step(model: GravityModel, samples: JointSamples, sigma: FloatArray) -> _Step:
    """Let the weights of the energy change; a tool brings no new features to an old chain."""
    old = model.energy
    assert old is not None
    count = len(old.indices)
    covariance = np.zeros((count, count)) if model.uncertainty is None \
        else model.uncertainty.covariance
    design = EnergyDesign(samples.q, np.broadcast_to(1.0 / sigma, samples.tau.shape))
    columns = design.columns(old.indices)
    left = samples.tau - model.predict(samples.q)
    residual, size = (left / sigma).T.ravel(), float(np.abs(left).max())
    change = average_change(ChangeProblem(columns.T, residual, covariance, np.arange(count),
                                          size))
    energy = Expansion(old.indices, old.weights + change.mean)
    changed = {feature_name(int(old.indices[k]), model.n_joints): float(change.mean[k])
               for k in change.support}
    spread = EnergyUncertainty(energy.indices, change.covariance)
    return _Step(_with_energy(model, energy, None, spread), changed, change)


def _with_energy(model: GravityModel, energy: Expansion, chain: Any,
                 uncertainty: Any) -> GravityModel:
    changed = GravityModel.from_energy(model.joints, model.formulation, energy, model.noise,
                                       model.coverage, model.provenance, chain, uncertainty)
    return replace(changed, applied=model.applied)


def _noise(fitted: GravityModel, samples: JointSamples, sigma: FloatArray,
           options: UpdateOptions) -> FloatArray:
    """Return each joint's noise (N,), from training and from the residual of the new samples."""
    residual = samples.tau - fitted.predict(samples.q)
    times = np.array([noise.correlation_time(column, samples.runs) for column in residual.T])
    inflation = np.where(times < _WHITE, 1.0, times)
    squares = inflation * (residual ** 2).sum(axis=0)
    return np.asarray(np.sqrt((options.old_noise * sigma ** 2 + squares)
                              / (options.old_noise + samples.n_samples)))


def _coverage(model: GravityModel, samples: JointSamples) -> Coverage:
    """Return the range that old and new samples span: the old ones taught all but the change."""
    return Coverage(np.minimum(model.coverage.q_min, samples.q.min(axis=0)),
                    np.maximum(model.coverage.q_max, samples.q.max(axis=0)),
                    samples.n_samples, samples.n_runs)


def _report(old: GravityModel, found: _Step, samples: JointSamples, rmse: FloatArray,
            sigma: FloatArray) -> dict[str, Any]:
    names = old.joints
    before = np.sqrt(((samples.tau - old.predict(samples.q)) ** 2).mean(axis=0))
    difference = found.model.predict(samples.q) - old.predict(samples.q)
    spread = found.model.predict_std(samples.q).max(axis=0)

    def by_joint(values: FloatArray) -> dict[str, float]:
        return dict(zip(names, np.asarray(values, dtype=float).tolist()))

    lasso = asdict(found.change.lasso)
    return {
        'formulation': old.formulation, 'n_samples': samples.n_samples,
        'rmse_before': by_joint(before), 'rmse': by_joint(rmse), 'noise': by_joint(sigma),
        'std': by_joint(spread),
        'effect_mean': by_joint(difference.mean(axis=0)),
        'effect_max': by_joint(np.abs(difference).max(axis=0)),
        'changed': found.changed,
        'log_evidence': found.change.log_evidence,
        'solver': {key: lasso[key] for key in
                   ('iterations', 'primal_residual', 'dual_residual', 'converged')},
    }
