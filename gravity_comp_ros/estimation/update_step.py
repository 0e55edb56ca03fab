"""The step of an update: what a tool changed of a chain, of an energy, or of an arm in metres."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation.chain_update import NewSamples, update_chain
from gravity_comp_ros.estimation.payload_estimate import PayloadEstimate, weigh
from gravity_comp_ros.estimation.payload_path import path_moments
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.sparse.dictionary import feature_name
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.models.sparse.sparse_change import average_change, Change, ChangeProblem
from gravity_comp_ros.models.uncertainty import ChainUncertainty, EnergyUncertainty
import numpy as np

# By how much a free change of moments may fit better (chi^2) before a tool is no longer believed.
# Of 102 updates with a tool in MuJoCo three were above: the law of friction is not quite right.
_NO_TOOL = 60.0


@dataclass(frozen=True)
class Step:
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


def step(model: GravityModel, new: NewSamples, geometry: Geometry | None,
         start: tuple[Chain, FloatArray] | None = None) -> Step:
    """
    Return the change of a model that explains new samples.

    :param geometry: of the arm, to weigh the tool; the model is a chain on its axes then.
    :param start: that of a step found before, with other noise.
    """
    if model.chain is None:
        return _energy_step(model, new)
    free = _chain_step(model, new, start)
    return free if geometry is None else _tool_step(model, new, geometry, free)


def _tool_step(model: GravityModel, new: NewSamples, geometry: Geometry, free: Step) -> Step:
    """Return the change by a tool, or the free one if that explains much more."""
    assert model.chain is not None and model.uncertainty is not None
    assert free.model.chain is not None
    tool = weigh(model.chain, model.uncertainty.covariance, new, geometry)
    left = [new.residual(each) for each in (tool.chain, free.model.chain)]
    if left[0] @ left[0] - left[1] @ left[1] > _NO_TOOL:
        return replace(free, tool=tool.weighed)
    spread = ChainUncertainty(tool.chain, tool.covariance)
    changed = (tool.chain.moments - model.chain.moments).ravel()
    return Step(_with_energy(model, expand(tool.chain), tool.chain, spread),
                {name: float(x) for name, x in zip(_moment_names(model), changed)},
                free.change, tool.weighed, True, free.start)


def _moment_names(model: GravityModel) -> list[str]:
    return [f'{name} {axis}' for name in model.joints for axis in 'xy']


def _chain_step(model: GravityModel, new: NewSamples,
                start: tuple[Chain, FloatArray] | None) -> Step:
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
    return Step(_with_energy(model, energy, found.chain,
                             ChainUncertainty(found.chain, found.covariance)),
                changed, found.change, start=found.start)


def _energy_step(model: GravityModel, new: NewSamples) -> Step:
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
    return Step(_with_energy(model, energy, None, spread), changed, change)


def _with_energy(model: GravityModel, energy: Expansion, chain: Chain | None,
                 uncertainty: ChainUncertainty | EnergyUncertainty) -> GravityModel:
    changed = GravityModel.from_energy(model.joints, model.formulation, energy, model.noise,
                                       model.coverage, model.provenance, chain, uncertainty)
    return replace(changed, applied=model.applied, history=model.history,
                   nuisance=model.nuisance, geometry=model.geometry)
