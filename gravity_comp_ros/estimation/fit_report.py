"""What a fit reports: errors of the model as it is, noise, nuisance terms, and warnings."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.estimation.chain_estimate import ChainEstimate
from gravity_comp_ros.estimation.formulation_choice import Choice
from gravity_comp_ros.estimation.regression import Regression
from gravity_comp_ros.estimation.robust import set_aside
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.alternative_chains import std_anywhere, unsure_joint
from gravity_comp_ros.models.kinematic.chain_fit import ChainFit
from gravity_comp_ros.models.noise import NoiseModel
from gravity_comp_ros.models.nuisance import COULOMB, NuisanceTerms, VISCOUS
from gravity_comp_ros.models.sparse.identifiability import at_rest
from gravity_comp_ros.models.sparse.sparse_problem import SparseFit
from gravity_comp_ros.printable import counted
import numpy as np


def build_report(model: GravityModel, samples: JointSamples, choice: Choice,
                 regression: Regression) -> dict[str, Any]:
    """Return the report of a fit, ready for JSON; errors are those of the model as it is."""
    found = choice.estimate
    chain = found.fit if isinstance(found, ChainEstimate) else None
    fits = [] if isinstance(found, ChainEstimate) else found.fits
    noises = [chain.noise] if chain else [each.noise for each in fits]
    report: dict[str, Any] = {
        'formulation': model.formulation,
        'choice': {'formulation': choice.formulation, 'why': choice.why,
                   'held_out': dict(choice.held_out)},
        'n_samples': samples.n_samples, 'n_runs': samples.n_runs,
        'n_fitted': regression.samples.n_samples,
        'features': dict(zip(model.joints, model.n_features().tolist())),
        'rmse': dict(zip(model.joints, model.noise.tolist())),
        'noise': {'absolute': _per_joint(model.joints, noises, 'absolute'),
                  'relative': _per_joint(model.joints, noises, 'relative')},
        'nuisance': nuisance_json(model.nuisance),
        'set_aside': {name: asdict(gone) for name, gone in
                      set_aside(regression.samples, regression.trust).items()},
        'solver': [_solver(each) for each in fits],
        'dropped_joints': [name for name, still in zip(samples.names, at_rest(samples.q))
                           if still],
        'warnings': [],
    }
    report['warnings'] = _warnings(samples, model, choice, chain, fits, report)
    if chain:
        report['chain'] = {
            'known_axes': choice.known_axes, **_chain_json(chain),
            'std_anywhere': dict(zip(model.joints, std_anywhere(
                chain.chain, chain.covariance).tolist()))}
    return report


def nuisance_json(nuisance: NuisanceTerms) -> list[dict[str, Any]]:
    """Return the nuisance terms with their 95 % intervals."""
    return [{'effect': term.kind, 'joint': term.joint, 'value': term.value, 'unit': term.unit,
             'ci95': [term.value - 1.96 * term.std, term.value + 1.96 * term.std],
             **({'acceleration_of': term.source} if term.source else {})}
            for term in nuisance.terms]


def nuisance_sentence(nuisance: NuisanceTerms) -> str | None:
    """Return one sentence on the nuisance terms, None if there are none."""
    friction = {term.joint for term in nuisance.terms if term.kind in (COULOMB, VISCOUS)}
    others = [term for term in nuisance.terms if term.kind not in (COULOMB, VISCOUS)]
    parts = []
    if friction:
        parts.append(f'friction on {len(friction)} joint{"s" if len(friction) > 1 else ""}')
    for kind, word in (('torque_offset', 'an offset'), ('inertia', 'inertia')):
        joints = {term.joint for term in others if term.kind == kind}
        if joints:
            parts.append(f'{word} on {len(joints)} joint{"s" if len(joints) > 1 else ""}')
    if not parts:
        return None
    listed = parts[0] if len(parts) == 1 else ', '.join(parts[:-1]) + ' and ' + parts[-1]
    return f'fitted beside gravity and not predicted: {listed}'


def _per_joint(joints: tuple[str, ...], models: list[NoiseModel],
               which: str) -> dict[str, float]:
    values = np.concatenate([getattr(model, which) for model in models])
    return dict(zip(joints, values.tolist()))


def _solver(found: SparseFit) -> dict[str, Any]:
    solution = found.lasso
    return {'lambda': solution.lam, 'iterations': solution.iterations,
            'rounds': found.rounds, 'working_set': solution.working_set,
            'l1_support': len(solution.indices), 'support': len(found.indices),
            'ties': found.ties, 'inflation': found.inflation,
            'converged': solution.converged,
            **asdict(solution.certificate)}


def _chain_json(chain: ChainFit) -> dict[str, Any]:
    return {'starts': chain.starts, 'steps': chain.steps, 'structure': chain.structure,
            'clean': chain.clean, 'right_angles': list(chain.square), 'base_tilt': chain.tilt,
            'rivals': chain.rivals, 'inflation': chain.inflation.tolist()}


def _warnings(samples: JointSamples, model: GravityModel, choice: Choice,
              chain: ChainFit | None, fits: list[SparseFit], report: dict[str, Any]) -> list[str]:
    lines = [choice.warning] if choice.warning else []
    if report['dropped_joints']:
        lines.append(f'{", ".join(report["dropped_joints"])} never moved: the model is valid only '
                     f'where it stood')
    if not any(torque.indices.size for torque in model.torques):
        lines.append('no torque differs from noise: the model is 0 everywhere. If gravity does '
                     'load the arm, record more poses')
    for name, gone in report['set_aside'].items():
        lines.append(f'set aside as outliers: {counted(gone["n"], "sample")} of {name}, from '
                     f'{gone["first"]:.1f} to {gone["last"]:.1f} s of {gone["label"]}')
    if chain:
        lines += _structure(model, chain) + _unsure(samples, model, chain)
    if not all(found.lasso.converged for found in fits):
        lines.append('ADMM did not reach its tolerance; its residuals are in the report')
    ties = sum(found.ties for found in fits)
    if ties:
        lines.append(f'{ties} feature{"s" if ties > 1 else ""} cannot be told from a neighbour '
                     f'on this motion; their average is used. A wider motion would settle it')
    return lines


def _structure(model: GravityModel, chain: ChainFit) -> list[str]:
    if chain.clean or model.nuisance.terms:
        return []
    return [f'the residual of the chain is not white ({chain.structure:.1f} standard deviations): '
            f'an effect is not modelled, or the arm is no serial chain']


def _unsure(samples: JointSamples, model: GravityModel, chain: ChainFit) -> list[str]:
    """Say how far a chain may be off away from where it was trained, if that is much."""
    sigma = np.sqrt((chain.noise.sigma(chain.chain.torque(samples.q)) ** 2).mean(axis=0))
    joint = unsure_joint(chain.chain, chain.covariance, np.maximum(sigma, 1e-9))
    if joint is None:
        return []
    std: FloatArray = std_anywhere(chain.chain, chain.covariance)
    others = f'; {chain.rivals} other chains explain these samples nearly as well' \
        if chain.rivals > 1 else '; another chain explains these samples nearly as well' \
        if chain.rivals else ''
    return [f'away from the trained poses the torque of {model.joints[joint]} may be off by '
            f'{1.96 * std[joint]:.2g} N·m (95 %){others}. Record more poses, further apart']
