"""
Few-sample update: a model after a tool change, from the model before it and seconds of motion.

A tool changes few of the numbers that a model consists of: some moments of a chain, some weights
of an energy. What the old model knew about all others stays, with its uncertainty (`change`).
Where the arm's lengths are known a tool is only four numbers (`payload`), and the model changes
by them, unless the samples say that it was something else that changed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import FitError, ModelMismatchError, OptionError
from gravity_comp_ros.estimation import robust
from gravity_comp_ros.estimation.chain_update import NewSamples, update_chain
from gravity_comp_ros.estimation.nuisance_columns import nuisance_torque
from gravity_comp_ros.estimation.payload_estimate import on_known_axes, PayloadEstimate, weigh
from gravity_comp_ros.estimation.payload_path import path_moments, payload_path
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.alternative_chains import std_anywhere, unsure_joint
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.nuisance import NuisanceTerms
from gravity_comp_ros.models.sparse.admm import AdmmResult
from gravity_comp_ros.models.sparse.dictionary import feature_name
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.models.sparse.sparse_change import average_change, Change, ChangeProblem
from gravity_comp_ros.models.uncertainty import ChainUncertainty, EnergyUncertainty
import numpy as np

# Shorter correlation times than this are what chance makes of white noise.
_WHITE = 2.0
# Noise that the new samples show to differ by no more changes no weights that matter.
_SAME_NOISE = 0.15
# With fewer samples than this the interval of an update is that of a guess of the noise.
_FEW = 30
# By how much a free change of moments may fit better (chi^2) before a tool is no longer believed.
_NO_TOOL = 40.0
# What is reported of ADMM's run.
_SOLVER = ('iterations', 'primal_residual', 'dual_residual', 'converged')


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
class UpdateDetails:
    """
    What an update reports.

    By joint, in N·m: `rmse_before` and `rmse` of the models before and after, `noise`, the
    prediction's largest standard deviation `std`, and mean and largest torque of the payload.
    `changed` are coefficients of the model; `payload` is None without known axes.
    """

    formulation: str
    n_samples: int
    rmse_before: Mapping[str, float]
    rmse: Mapping[str, float]
    noise: Mapping[str, float]
    std: Mapping[str, float]
    effect_mean: Mapping[str, float]
    effect_max: Mapping[str, float]
    changed: Mapping[str, float]
    payload: PayloadEstimate | None
    log_evidence: float
    solver: AdmmResult = field(compare=False)
    warnings: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the report as a model's provenance and `update --json` hold it."""
        solver = {name: getattr(self.solver, name) for name in _SOLVER}
        return {**vars(self), 'payload': None if self.payload is None else asdict(self.payload),
                'solver': solver, 'warnings': list(self.warnings)}


@dataclass(frozen=True)
class UpdateResult:
    """The model with the new tool, and what is to be said of it."""

    model: GravityModel
    report: UpdateDetails


def update(model: GravityModel, samples: JointSamples,
           options: UpdateOptions = UpdateOptions(),
           geometry: Geometry | None = None) -> UpdateResult:
    """
    Return the model that explains `samples`, taken after a tool change, by a sparse change.

    :param model: of the chain or the potential formulation.
    :param samples: gated; joints are matched by name. Fifty (10 s at 5 Hz) are a good number.
        Their torque is gravity: what the effects of the model do must have been taken off.
    :param geometry: of this arm, to weigh the tool; the new model is a chain on its axes, with
        the joints in its order.
    :raises ModelMismatchError: if the samples lack a joint, the model is per_joint and there is
        no geometry, or the geometry is of another arm.
    :raises FitError: if there are too few samples.
    """
    samples = samples.joints(model.joints)
    if samples.n_samples < options.min_samples:
        raise FitError(f'{samples.n_samples} slow samples since the tool changed; an update needs '
                       f'{options.min_samples}. Move on slowly')
    if geometry is not None:
        return _update(_on_axes(model, geometry), samples.joints(geometry.joints), options,
                       geometry)
    if model.energy is None:
        raise ModelMismatchError('a per_joint model has no energy whose change a tool would be; '
                                 'fit it again, or keep a chain or potential model')
    return _update(model, samples, options, None)


def _update(model: GravityModel, measured: JointSamples, options: UpdateOptions,
            geometry: Geometry | None) -> UpdateResult:
    # Friction and offsets that were seen before the change are carried over.
    samples = replace(measured, tau=measured.tau - nuisance_torque(model.nuisance, measured))
    sigma = np.maximum(model.noise_beside, noise.floor(samples.tau))
    new = NewSamples(samples.q, samples.tau, sigma, change_trust(model, samples))
    found = _step(model, new, geometry)
    sigma = _noise(found.model, samples, new, options)
    if not np.allclose(sigma, new.sigma, rtol=_SAME_NOISE):
        found = _step(model, replace(new, sigma=sigma), geometry, found.start)
    # Errors are those of the model as it predicts, friction that it does not predict included.
    rmse = np.sqrt(((measured.tau - found.model.predict(measured.q)) ** 2).mean(axis=0))
    report = _report(model, found, measured, rmse, sigma)
    provenance = {**model.provenance,
                  'updates': [*model.provenance.get('updates', []), report.to_json()]}
    nuisance = found.model.nuisance
    if nuisance.noise.size:
        nuisance = NuisanceTerms(nuisance.terms, nuisance.width, nuisance.hold, sigma)
    updated = replace(found.model, noise=np.maximum(sigma, rmse), nuisance=nuisance,
                      coverage=_coverage(model, samples), provenance=provenance,
                      payload_path=payload_path(model, found.model))
    return UpdateResult(updated, report)


def change_trust(model: GravityModel, samples: JointSamples) -> FloatArray:
    """
    Return how far each torque is trusted (M, N): transients and pushes are no tool.

    :param model: of the arm before the change, a chain or a potential.
    :param samples: after the change; their torque is gravity.
    """
    if model.chain is not None:
        columns = ForwardKinematics(model.chain.axes, samples.q).moment_columns()
    else:
        assert model.energy is not None
        design = EnergyDesign(samples.q, np.ones(samples.tau.shape))
        columns = design.columns(model.energy.indices).T.reshape(-1, *samples.tau.T.shape)
    return robust.trust_beside(samples.tau - model.predict(samples.q), columns,
                               noise.floor(samples.tau))


def _on_axes(model: GravityModel, geometry: Geometry) -> GravityModel:
    """Return the same gravity as a chain on known axes."""
    chain, covariance, geometry = on_known_axes(model, geometry)
    order = [model.joints.index(name) for name in geometry.joints]
    coverage = replace(model.coverage, q_min=model.coverage.q_min[order],
                       q_max=model.coverage.q_max[order])
    made = GravityModel.from_energy(
        geometry.joints, 'chain', expand(chain), model.noise[order], coverage, model.provenance,
        chain, ChainUncertainty(chain, covariance))
    direction = {name: numbers[order] for name, numbers in model.applied.direction.items()}
    return replace(made, applied=replace(model.applied, direction=direction),
                   history=model.history, nuisance=model.nuisance.in_order(order),
                   geometry=geometry)


@dataclass(frozen=True)
class _Step:
    """
    A changed model, what changed by name and in N·m, and how it was found.

    `tool` is what was weighed, None without lengths; `is_tool` says that the model changed by it.
    `start` is where the search for a chain ended up beginning, for another with other noise.
    """

    model: GravityModel
    changed: dict[str, float]
    change: Change
    tool: PayloadEstimate | None = None
    is_tool: bool = False
    start: tuple[Chain, FloatArray] | None = None


def _step(model: GravityModel, new: NewSamples, geometry: Geometry | None,
          start: tuple[Chain, FloatArray] | None = None) -> _Step:
    if model.chain is None:
        return _energy_step(model, new)
    free = _chain_step(model, new, start)
    return free if geometry is None else _tool_step(model, new, geometry, free)


def _tool_step(model: GravityModel, new: NewSamples, geometry: Geometry, free: _Step) -> _Step:
    """Return the change by a tool, or the free one if that explains much more."""
    assert model.chain is not None and model.uncertainty is not None
    assert free.model.chain is not None
    tool = weigh(model.chain, model.uncertainty.covariance, new, geometry)
    left = new.residual(free.model.chain)
    if tool.chi2 - float(left @ left) > _NO_TOOL:
        return replace(free, tool=tool.weighed)
    spread = ChainUncertainty(tool.chain, tool.covariance)
    changed = (tool.chain.moments - model.chain.moments).ravel()
    return _Step(_with_energy(model, expand(tool.chain), tool.chain, spread),
                 {name: float(x) for name, x in zip(_moment_names(model), changed)},
                 free.change, tool.weighed, True, free.start)


def _moment_names(model: GravityModel) -> list[str]:
    return [f'{name} {axis}' for name in model.joints for axis in 'xy']


def _chain_step(model: GravityModel, new: NewSamples,
                start: tuple[Chain, FloatArray] | None) -> _Step:
    assert model.chain is not None
    n = model.n_joints
    covariance = np.zeros((4 * n, 4 * n)) if model.uncertainty is None \
        else model.uncertainty.covariance
    box = np.stack([model.coverage.q_min, model.coverage.q_max])
    path = None if model.payload_path is None else path_moments(model.payload_path, model.chain,
                                                                box)
    found = update_chain(model.chain, covariance, new, box, start, path)
    names, moments = _moment_names(model), found.chain.moments - model.chain.moments
    changed = {names[k]: float(moments.ravel()[k]) for k in found.change.support - 2 * n}
    energy = expand(found.chain)
    return _Step(_with_energy(model, energy, found.chain,
                              ChainUncertainty(found.chain, found.covariance)),
                 changed, found.change, start=found.start)


def _energy_step(model: GravityModel, new: NewSamples) -> _Step:
    """Let the weights of the energy change; a tool brings no new features to an old chain."""
    old = model.energy
    assert old is not None
    count = len(old.indices)
    covariance = np.zeros((count, count)) if model.uncertainty is None \
        else model.uncertainty.covariance
    columns = EnergyDesign(new.q, new.row_weights).columns(old.indices)
    left = new.tau - model.predict(new.q)
    residual = (left * new.row_weights).T.ravel()
    size = float(np.abs(left[new.trust > 0.0]).max())
    change = average_change(ChangeProblem(columns.T, residual, covariance, np.arange(count),
                                          size))
    energy = Expansion(old.indices, old.weights + change.mean)
    changed = {feature_name(int(old.indices[k]), model.n_joints): float(change.mean[k])
               for k in change.support}
    spread = EnergyUncertainty(energy.indices, change.covariance)
    return _Step(_with_energy(model, energy, None, spread), changed, change)


def _with_energy(model: GravityModel, energy: Expansion, chain: Chain | None,
                 uncertainty: ChainUncertainty | EnergyUncertainty) -> GravityModel:
    changed = GravityModel.from_energy(model.joints, model.formulation, energy, model.noise,
                                       model.coverage, model.provenance, chain, uncertainty)
    return replace(changed, applied=model.applied, history=model.history,
                   nuisance=model.nuisance, geometry=model.geometry)


def _noise(fitted: GravityModel, samples: JointSamples, new: NewSamples,
           options: UpdateOptions) -> FloatArray:
    """Return each joint's noise (N,), from training and from the residual of the new samples."""
    residual = np.sqrt(new.trust) * (new.tau - fitted.predict(new.q))
    times = np.array([noise.correlation_time(column, samples.runs) for column in residual.T])
    inflation = np.where(times < _WHITE, 1.0, times)
    squares = inflation * (residual ** 2).sum(axis=0)
    return np.asarray(np.sqrt((options.old_noise * new.sigma ** 2 + squares)
                              / (options.old_noise + new.trust.sum(axis=0))))


def _coverage(model: GravityModel, samples: JointSamples) -> Coverage:
    """Return the range that old and new samples span: the old ones taught all but the change."""
    return Coverage(np.minimum(model.coverage.q_min, samples.q.min(axis=0)),
                    np.maximum(model.coverage.q_max, samples.q.max(axis=0)),
                    samples.n_samples, samples.n_runs)


def _report(old: GravityModel, found: _Step, samples: JointSamples, rmse: FloatArray,
            sigma: FloatArray) -> UpdateDetails:
    before = np.sqrt(((samples.tau - old.predict(samples.q)) ** 2).mean(axis=0))
    difference = found.model.predict(samples.q) - old.predict(samples.q)
    spread = found.model.predict_std(samples.q).max(axis=0)
    warnings = _unsure(found.model, sigma)
    if len(samples) < _FEW:
        warnings.insert(0, f'{len(samples)} slow samples are few: from {_FEW} on, 6 s at 5 Hz, '
                        f'an update is as sure as it says')
    if found.tool is not None and not found.is_tool:
        warnings.append('a rigid body on the last link does not explain what changed; the mass '
                        'and centre told here are only the nearest to it')

    def by_joint(values: FloatArray) -> dict[str, float]:
        return dict(zip(old.joints, values.tolist()))

    return UpdateDetails(
        found.model.formulation, samples.n_samples, by_joint(before), by_joint(rmse),
        by_joint(sigma), by_joint(spread), by_joint(difference.mean(axis=0)),
        by_joint(np.abs(difference).max(axis=0)), found.changed, found.tool,
        found.change.log_evidence, found.change.lasso, tuple(warnings))


def _unsure(model: GravityModel, sigma: FloatArray) -> list[str]:
    """Say how far a chain may be off away from the samples, if that is much."""
    if model.chain is None or model.uncertainty is None:
        return []
    joint = unsure_joint(model.chain, model.uncertainty.covariance, sigma)
    if joint is None:
        return []
    std = std_anywhere(model.chain, model.uncertainty.covariance)[joint]
    return [f'away from these poses the torque of {model.joints[joint]} may be off by '
            f'{1.96 * std:.2g} N·m (95 %); more motion with the new payload tells more']
