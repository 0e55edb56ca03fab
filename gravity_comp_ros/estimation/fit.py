"""From gated samples to a gravity model and a report of how it came about."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import FitError, ModelMismatchError, OptionError
from gravity_comp_ros.estimation.formulation_choice import Choice, choose
from gravity_comp_ros.models.gravity_model import Coverage, FORMULATIONS, GravityModel
from gravity_comp_ros.models.kinematic.alternative_chains import std_anywhere, unsure_joint
from gravity_comp_ros.models.kinematic.chain_fit import ChainFit, fit_chain
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.noise import NoiseModel
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.models.sparse.identifiability import at_rest
from gravity_comp_ros.models.sparse.per_joint import fit_per_joint
from gravity_comp_ros.models.sparse.potential import fit_potential
from gravity_comp_ros.models.sparse.sparse_problem import SparseFit, SparseOptions
from gravity_comp_ros.models.uncertainty import ChainUncertainty, EnergyUncertainty
import numpy as np

MIN_SAMPLES = 10
# What may be asked for: a formulation, or to let the data choose between chain and potential.
CHOICES = (*FORMULATIONS, 'auto')

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class FitOptions:
    """
    What to fit: the `formulation`, and how its sparse problems are solved.

    `auto` fits the chain and falls back to the potential where that predicts held-out samples
    better; the report says which and why. With a `geometry` the axes of the chain are taken from
    it and only its moments are fitted; the samples' joints must be in its order.

    :raises OptionError: if the formulation is unknown, or has no use for a geometry.
    """

    formulation: str = 'potential'
    sparse: SparseOptions = SparseOptions()
    geometry: Geometry | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if self.formulation not in CHOICES:
            raise OptionError(f'unknown formulation {self.formulation!r}; choose from '
                              f'{", ".join(CHOICES)}')
        if self.geometry is not None and self.formulation not in ('chain', 'auto'):
            raise OptionError(f'known axes are of no use to {self.formulation}; choose chain or '
                              f'auto')

    def known(self, samples: JointSamples) -> FloatArray | None:
        """
        Return the axes (N, 3, 3) that are known, if they are.

        :raises ModelMismatchError: if they are of other joints, or of others first.
        """
        if self.geometry is None:
            return None
        if self.geometry.joints != samples.names:
            raise ModelMismatchError(f'axes are known of {", ".join(self.geometry.joints)}, but '
                                     f'the samples are of {", ".join(samples.names)}')
        return self.geometry.rotations

    def to_json(self) -> dict[str, Any]:
        """Return the options as a model's provenance tells them."""
        return {'formulation': self.formulation, 'sparse': asdict(self.sparse),
                'known_axes': self.geometry is not None}


@dataclass(frozen=True)
class FitResult:
    """A model, a report ready for JSON, and whether every L1 problem converged."""

    model: GravityModel
    report: dict[str, Any]
    converged: bool


def fit(samples: JointSamples, options: FitOptions = FitOptions(),
        progress: Progress | None = None, old: GravityModel | None = None) -> FitResult:
    """
    Learn the gravity torque from slow-motion samples.

    :param samples: gated already: tau is gravity plus noise and whatever is not modelled.
    :param progress: called with a word and a share from 0 to 1.
    :param old: a model of the same joints and formulation, `potential` or `per_joint`, to start
        from; another one is of no use here and is left aside.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises ModelMismatchError: if the options know the axes of other joints.
    """
    _check(samples)
    if progress:
        progress('fit', 0.0)
    report: dict[str, Any] = {}
    usable = (old is not None and old.joints == samples.names
              and old.formulation == options.formulation)
    if options.formulation == 'auto':
        choice = choose(samples, options.sparse, options.known(samples))
        report['choice'] = {'formulation': choice.formulation, 'why': choice.why,
                            'held_out': dict(zip(('chain', 'potential'), choice.errors))}
        model, fits, chain = _chosen(samples, choice)
    elif options.formulation == 'chain':
        chain, fits = fit_chain(samples, known=options.known(samples)), []
        model = _chain_model(samples, chain)
    elif options.formulation == 'potential':
        energy, fits = fit_potential(samples, options.sparse,
                                     old.energy if usable and old else None)
        model, chain = _potential_model(samples, energy, fits), None
    else:
        torques, fits = fit_per_joint(samples, options.sparse,
                                      old.torques if usable and old else None)
        chain = None
        model = GravityModel(samples.names, 'per_joint', torques, None,
                             np.zeros(samples.n_joints), _coverage(samples))
    result = _finish(model, samples, fits, chain, options, report)
    if progress:
        progress('fit', 1.0)
    return result


def _chosen(samples: JointSamples, choice: Choice
            ) -> tuple[GravityModel, list[SparseFit], ChainFit | None]:
    if choice.energy is None or choice.formulation == 'chain':
        return _chain_model(samples, choice.chain), [], choice.chain
    return _potential_model(samples, choice.energy, choice.fits), choice.fits, None


def _chain_model(samples: JointSamples, found: ChainFit) -> GravityModel:
    return GravityModel.from_energy(
        samples.names, 'chain', expand(found.chain), np.zeros(samples.n_joints),
        _coverage(samples), {}, found.chain, ChainUncertainty(found.chain, found.covariance))


def _potential_model(samples: JointSamples, energy: Expansion,
                     fits: list[SparseFit]) -> GravityModel:
    return GravityModel.from_energy(
        samples.names, 'potential', energy, np.zeros(samples.n_joints), _coverage(samples), {},
        uncertainty=EnergyUncertainty(energy.indices, fits[0].covariance))


def _coverage(samples: JointSamples) -> Coverage:
    return Coverage(samples.q.min(axis=0), samples.q.max(axis=0), samples.n_samples,
                    samples.n_runs)


def _finish(model: GravityModel, samples: JointSamples, fits: list[SparseFit],
            chain: ChainFit | None, options: FitOptions,
            report: dict[str, Any]) -> FitResult:
    residual = samples.tau - model.predict(samples.q)
    noise = np.sqrt((residual ** 2).mean(axis=0))
    models = [chain.noise] if chain else [found.noise for found in fits]
    report = {
        'formulation': model.formulation,
        'n_samples': samples.n_samples,
        'n_runs': samples.n_runs,
        'features': dict(zip(model.joints, model.n_features().tolist())),
        'rmse': dict(zip(model.joints, noise.tolist())),
        'noise': {'absolute': _per_joint(model.joints, models, 'absolute'),
                  'relative': _per_joint(model.joints, models, 'relative')},
        'solver': [_solver(found) for found in fits],
        'dropped_joints': [name for name, still in zip(samples.names, at_rest(samples.q))
                           if still],
        'warnings': _warnings(samples, model, fits, chain),
        **report,
    }
    if chain:
        report['chain'] = {
            'known_axes': options.geometry is not None, **_chain_report(chain),
            'std_anywhere': _by_joint(model, std_anywhere(chain.chain, chain.covariance))}
    model = replace(model, noise=noise,
                    provenance={'options': options.to_json(), 'report': report})
    converged = chain is not None or all(found.lasso.converged for found in fits)
    return FitResult(model, report, converged)


def _check(samples: JointSamples) -> None:
    if samples.n_samples < MIN_SAMPLES:
        raise FitError(f'{samples.n_samples} slow samples; a fit needs at least {MIN_SAMPLES}. '
                       f'Move longer, more slowly, or raise the speed limit of the gate')
    if at_rest(samples.q).all():
        raise FitError('no joint moves; a fit needs poses that differ')
    if not samples.tau.any():
        raise FitError('effort is 0 for every joint; does the driver publish it?')


def _per_joint(joints: tuple[str, ...], models: list[NoiseModel],
               which: str) -> dict[str, float]:
    values = np.concatenate([getattr(model, which) for model in models])
    return dict(zip(joints, values.tolist()))


def _unsure(samples: JointSamples, model: GravityModel, chain: ChainFit) -> list[str]:
    """Say how far a chain may be off away from where it was trained, if that is much."""
    sigma = np.sqrt((chain.noise.sigma(chain.chain.torque(samples.q)) ** 2).mean(axis=0))
    joint = unsure_joint(chain.chain, chain.covariance, np.maximum(sigma, 1e-9))
    if joint is None:
        return []
    std = std_anywhere(chain.chain, chain.covariance)[joint]
    others = f', and {chain.rivals} other chains explain them nearly as well' if chain.rivals > 1 \
        else ', and another chain explains them nearly as well' if chain.rivals else ''
    return [f'away from the trained poses the torque of {model.joints[joint]} may be off by '
            f'{1.96 * std:.2g} N·m (95 %): these samples do not tell the arm well{others}. '
            f'Move on, and further']


def _solver(found: SparseFit) -> dict[str, Any]:
    solution = found.lasso
    return {'lambda': solution.lam, 'iterations': solution.iterations,
            'rounds': found.rounds, 'working_set': solution.working_set,
            'l1_support': len(solution.indices), 'support': len(found.indices),
            'ties': found.ties, 'inflation': found.inflation,
            'converged': solution.converged,
            **asdict(solution.certificate)}


def _by_joint(model: GravityModel, values: FloatArray) -> dict[str, float]:
    return dict(zip(model.joints, values.tolist()))


def _chain_report(chain: ChainFit) -> dict[str, Any]:
    return {'starts': chain.starts, 'steps': chain.steps, 'structure': chain.structure,
            'clean': chain.clean, 'right_angles': list(chain.square), 'base_tilt': chain.tilt,
            'rivals': chain.rivals, 'inflation': chain.inflation.tolist()}


def _warnings(samples: JointSamples, model: GravityModel, fits: list[SparseFit],
              chain: ChainFit | None) -> list[str]:
    words = []
    still = [name for name, rest in zip(samples.names, at_rest(samples.q)) if rest]
    if still:
        words.append(f'{", ".join(still)} never moved: features of it are dropped, and the '
                     f'model holds only where it stood')
    if not any(torque.indices.size for torque in model.torques):
        words.append('no torque stands out of its noise: the model is 0 everywhere. If gravity '
                     'does load the arm, record more poses')
    if chain and not chain.clean:
        words.append(f'what the chain leaves over is no noise ({chain.structure:.1f} standard '
                     f'deviations): friction or another effect, or a wrong chain. Compare with '
                     f'potential')
    if chain:
        words += _unsure(samples, model, chain)
    if not all(found.lasso.converged for found in fits):
        words.append('ADMM did not reach its tolerance; its residuals are in the report')
    ties = sum(found.ties for found in fits)
    if ties:
        words.append(f'{ties} feature{"s" if ties > 1 else ""} cannot be told from a neighbour '
                     f'on this motion; their average is used. A wider motion would settle it')
    return words
