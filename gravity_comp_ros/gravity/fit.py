"""From gated samples to a gravity model and a report of how it came about."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from gravity_comp_ros.errors import FitError, OptionError
from gravity_comp_ros.gravity.factors import at_rest
from gravity_comp_ros.gravity.model import Coverage, FORMULATIONS, GravityModel
from gravity_comp_ros.gravity.per_joint import fit_per_joint
from gravity_comp_ros.gravity.potential import fit_potential
from gravity_comp_ros.gravity.sparse import SparseFit, SparseOptions
from gravity_comp_ros.samples import JointSamples
import numpy as np

MIN_SAMPLES = 10

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class FitOptions:
    """
    What to fit: the `formulation`, and how its sparse problems are solved.

    :raises OptionError: if the formulation is unknown.
    """

    formulation: str = 'potential'
    sparse: SparseOptions = SparseOptions()

    def __post_init__(self) -> None:
        if self.formulation not in FORMULATIONS:
            raise OptionError(f'unknown formulation {self.formulation!r}; choose from '
                              f'{", ".join(FORMULATIONS)}')


@dataclass(frozen=True)
class FitResult:
    """A model, a report ready for JSON, and whether every L1 problem converged."""

    model: GravityModel
    report: dict[str, Any]
    converged: bool


def fit(samples: JointSamples, options: FitOptions = FitOptions(),
        progress: Progress | None = None) -> FitResult:
    """
    Learn the gravity torque from slow-motion samples.

    :param samples: gated already: tau is gravity plus noise and whatever is not modelled.
    :param progress: called with a word and a share from 0 to 1.
    :raises FitError: if there are too few samples, or no joint moves.
    """
    _check(samples)
    if progress:
        progress('fit', 0.0)
    coverage = Coverage(samples.q.min(axis=0), samples.q.max(axis=0), samples.n_samples,
                        samples.n_runs)
    noise_of = np.zeros(samples.n_joints)
    provenance: dict[str, Any] = {'options': asdict(options)}
    if options.formulation == 'potential':
        energy, fits = fit_potential(samples, options.sparse)
        model = GravityModel.from_energy(samples.names, 'potential', energy, noise_of,
                                         coverage, provenance)
    else:
        torques, fits = fit_per_joint(samples, options.sparse)
        model = GravityModel(samples.names, 'per_joint', torques, None, noise_of, coverage,
                             provenance)
    return _finish(model, samples, fits, progress)


def _finish(model: GravityModel, samples: JointSamples, fits: list[SparseFit],
            progress: Progress | None) -> FitResult:
    residual = samples.tau - model.predict(samples.q)
    noise = np.sqrt((residual ** 2).mean(axis=0))
    report = {
        'formulation': model.formulation,
        'n_samples': samples.n_samples,
        'n_runs': samples.n_runs,
        'features': dict(zip(model.joints, model.n_features().tolist())),
        'rmse': dict(zip(model.joints, noise.tolist())),
        'noise': {'absolute': _per_joint(model.joints, fits, 'absolute'),
                  'relative': _per_joint(model.joints, fits, 'relative')},
        'solver': [_solver(found) for found in fits],
        'dropped_joints': [name for name, still in zip(samples.names, at_rest(samples.q))
                           if still],
        'warnings': _warnings(samples, fits),
    }
    provenance = {**model.provenance, 'report': report}
    model = GravityModel(model.joints, model.formulation, model.torques, model.energy, noise,
                         model.coverage, provenance)
    if progress:
        progress('fit', 1.0)
    return FitResult(model, report, all(found.lasso.converged for found in fits))


def _check(samples: JointSamples) -> None:
    if samples.n_samples < MIN_SAMPLES:
        raise FitError(f'{samples.n_samples} slow samples; a fit needs at least {MIN_SAMPLES}. '
                       f'Move longer, more slowly, or raise the speed limit of the gate')
    if at_rest(samples.q).all():
        raise FitError('no joint moves; a fit needs poses that differ')
    if not samples.tau.any():
        raise FitError('effort is 0 for every joint; does the driver publish it?')


def _per_joint(joints: tuple[str, ...], fits: list[SparseFit], which: str) -> dict[str, float]:
    values = np.concatenate([getattr(found.noise, which) for found in fits])
    return dict(zip(joints, values.tolist()))


def _solver(found: SparseFit) -> dict[str, Any]:
    solution = found.lasso
    return {'lambda': solution.lam, 'iterations': solution.iterations,
            'rounds': found.rounds, 'working_set': solution.working_set,
            'l1_support': len(solution.indices), 'support': len(found.indices),
            'ties': found.ties, 'inflation': found.inflation,
            'converged': solution.converged,
            **asdict(solution.certificate)}


def _warnings(samples: JointSamples, fits: list[SparseFit]) -> list[str]:
    words = []
    still = [name for name, rest in zip(samples.names, at_rest(samples.q)) if rest]
    if still:
        words.append(f'{", ".join(still)} never moved: features of it are dropped, and the '
                     f'model holds only where it stood')
    if not any(found.indices.size for found in fits):
        words.append('no torque stands out of its noise: the model is 0 everywhere. If gravity '
                     'does load the arm, record more poses')
    if not all(found.lasso.converged for found in fits):
        words.append('ADMM did not reach its tolerance; its residuals are in the report')
    ties = sum(found.ties for found in fits)
    if ties:
        words.append(f'{ties} feature{"s" if ties > 1 else ""} cannot be told from a neighbour '
                     f'on this motion; their average is used. A wider motion would settle it')
    return words
