"""
The one estimator: from samples to a gravity model and a report of how it came about.

Friction, offset and, where fast samples are fitted, inertia of every joint are fitted beside
gravity (`models.nuisance`), outliers count for less (`estimation.robust`), and long recordings
are condensed (`data.condense`). `fit`, `add`, `update`, the base of the diagnosis, the node, the
workbench and the fleet all use what is here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.data.velocity_check import checked_velocity
from gravity_comp_ros.effects.motion import accelerations
from gravity_comp_ros.errors import FitError, ModelMismatchError, OptionError
from gravity_comp_ros.estimation.chain_estimate import ChainEstimate, estimate_chain
from gravity_comp_ros.estimation.fit_report import build_report, FitDetails
from gravity_comp_ros.estimation.formulation_choice import Choice, choose
from gravity_comp_ros.estimation.nominal_motion import without_motion
from gravity_comp_ros.estimation.regression import build_regression, is_fast, Regression
from gravity_comp_ros.estimation.sparse_estimate import estimate_sparse, SparseEstimate
from gravity_comp_ros.models.gravity_model import Coverage, FORMULATIONS, GravityModel
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.vertical import on_vertical
from gravity_comp_ros.models.kinematic.zero_angles import with_zero_angles
from gravity_comp_ros.models.nuisance import NuisanceTerms, OFFSET
from gravity_comp_ros.models.sparse.identifiability import at_rest
from gravity_comp_ros.models.sparse.sparse_problem import SparseOptions
from gravity_comp_ros.models.uncertainty import ChainUncertainty, EnergyUncertainty
import numpy as np

MIN_SAMPLES = 10
# Samples that show zero angles.
_POSES = 600
# What may be asked for: a formulation, or to let the data choose between chain and potential.
CHOICES = ('auto', *FORMULATIONS)

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

    formulation: str = 'auto'
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
            raise ModelMismatchError(f'the known axes are of {", ".join(self.geometry.joints)}, '
                                     f'but the samples are of {", ".join(samples.names)}')
        return self.geometry.rotations

    def to_json(self) -> dict[str, Any]:
        """Return the options as a model's provenance tells them."""
        return {'formulation': self.formulation, 'sparse': asdict(self.sparse),
                'known_axes': self.geometry is not None}


@dataclass(frozen=True)
class FitResult:
    """A model, a report, and whether every L1 problem converged."""

    model: GravityModel
    report: FitDetails
    converged: bool

    def to_json(self) -> dict[str, Any]:
        """Return `joints`, `report` and `converged` as `fit --json` prints them."""
        model, report = self.model, self.report
        joints = {name: {
            'features': report.features[name], 'rmse': report.rmse[name],
            'noise': report.noise[name], 'relative_noise': report.relative_noise[name],
            'q_min': model.coverage.q_min[n], 'q_max': model.coverage.q_max[n],
            'equation': model.equation(name)} for n, name in enumerate(model.joints)}
        return {'joints': joints, 'report': report.to_json(), 'converged': self.converged}

    def warned(self, warning: str) -> FitResult:
        """Return the same with one more warning, told first, here and in the provenance."""
        warnings, told = (warning, *self.report.warnings), self.model.provenance
        told = {**told, 'report': {**told['report'], 'warnings': list(warnings)}}
        return replace(self, report=replace(self.report, warnings=warnings),
                       model=replace(self.model, provenance=told))


@dataclass(frozen=True, eq=False)
class Estimate:
    """
    Gravity as it was estimated: the `choice` among formulations, and whatever is beside it.

    `effects` (K,) and `covariance` (K, K) are the coefficients of the regression's effects.
    """

    choice: Choice
    regression: Regression
    effects: FloatArray
    covariance: FloatArray


def fit(samples: JointSamples, options: FitOptions = FitOptions(),
        progress: Progress | None = None, old: GravityModel | None = None,
        qdd: FloatArray | None = None) -> FitResult:
    """
    Learn the gravity torque from samples.

    :param samples: slow motion, or motion of any speed: inertia is then fitted beside gravity.
    :param progress: called with a word and a share from 0 to 1.
    :param old: a model of the same joints to start from. It saves a search and binds nothing.
    :param qdd: accelerations (M, N) in rad/s^2 of the samples; None computes them.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises ModelMismatchError: if the options have the axes of other joints.
    """
    _check(samples)
    if progress:
        progress('fit', 0.0)
    samples, warning = checked_velocity(samples)
    stands = options
    if options.known(samples) is not None and options.geometry is not None:
        qdd = accelerations(samples) if qdd is None else qdd
        stands = replace(options, geometry=_as_it_stands(options.geometry, samples, qdd))
    estimate = _estimate(samples, stands, old, qdd)
    model = gravity_model(estimate, samples)
    report = build_report(model, samples, estimate.choice, estimate.regression, warning,
                          options.geometry)
    model = replace(model, geometry=_geometry(stands, estimate),
                    provenance={'options': options.to_json(), 'report': report.to_json()})
    if progress:
        progress('fit', 1.0)
    found = estimate.choice.estimate
    converged = isinstance(found, ChainEstimate) or all(f.lasso.converged for f in found.fits)
    return FitResult(model, report, converged)


def _as_it_stands(geometry: Geometry, samples: JointSamples, qdd: FloatArray) -> Geometry:
    """
    Return the geometry with the vertical and the zero angles that the torque shows.

    What the nominal arm lacks of the torque of fast motion looks like zero angles.
    """
    geometry = on_vertical(geometry, samples)
    if is_fast(samples):
        return geometry
    rows = evenly_picked(samples.n_samples, _POSES)
    return with_zero_angles(geometry, without_motion(samples.select(rows), geometry, qdd[rows]))


def _estimate(samples: JointSamples, options: FitOptions, old: GravityModel | None,
              qdd: FloatArray | None) -> Estimate:
    """Return gravity beside the torque of motion that an arm with the known axes would have."""
    found = estimate_gravity(
        build_regression(samples, qdd=qdd, geometry=options.geometry), options, old)
    if not found.choice.warning:
        return found
    # The axes are of another arm, and so was the torque of motion that was taken off.
    return estimate_gravity(build_regression(samples, qdd=qdd), options, old)


def estimate_gravity(regression: Regression, options: FitOptions,
                     old: GravityModel | None = None, known: FloatArray | None = None,
                     warm: bool = False) -> Estimate:
    """
    Estimate gravity beside everything that the regression has, in the formulation asked for.

    :param known: axes (N, 3, 3) that need no search; those of the options if not given.
    :param warm: whether the search for a chain starts from that of `old` and nowhere else.
    :raises FitError: if there are no samples.
    :raises ModelMismatchError: if the options have the axes of other joints.
    """
    samples, formulation = regression.samples, options.formulation
    usable = old if old is not None and old.joints == samples.names else None
    known = options.known(samples) if known is None else known
    start = usable.chain if usable is not None else None
    if formulation == 'auto':
        bare = usable is not None and start is not None and not any(
            term.kind == OFFSET for term in usable.nuisance.terms)
        choice = choose(regression, options.sparse, known, start, warm, bare)
    elif formulation == 'chain':
        choice = Choice(estimate_chain(regression, known, start, warm), 'it was asked for', {},
                        known is not None)
    else:
        settled = regression.accelerated and formulation == 'potential'
        if settled:
            # Inertia has N columns a joint: the chain tells which of them matter.
            regression = estimate_chain(regression, start=start).regression
        before = None if usable is None or usable.formulation != formulation else (
            usable.energy if formulation == 'potential' else usable.torques)
        choice = Choice(estimate_sparse(regression, formulation, options.sparse, before, settled),
                        'it was asked for')
    found, k = choice.estimate, regression.n_effects
    return Estimate(choice, found.regression, found.beside[:k], found.covariance[:k, :k])


def gravity_model(estimate: Estimate, samples: JointSamples) -> GravityModel:
    """
    Return the model of an estimate; its noise is the RMSE of its own prediction of `samples`.

    :param samples: all that were fitted, before condensing.
    """
    found, names = estimate.choice.estimate, samples.names
    coverage = Coverage.of(samples)
    noise = np.zeros(samples.n_joints)
    if isinstance(found, ChainEstimate):
        chain = found.chain
        model = GravityModel.from_energy(names, 'chain', expand(chain), noise, coverage, {}, chain,
                                         ChainUncertainty(chain, found.fit.covariance))
    elif found.energy is not None:
        model = GravityModel.from_energy(
            names, 'potential', found.energy, noise, coverage, {},
            uncertainty=EnergyUncertainty(found.energy.indices, found.fits[0].covariance))
    else:
        model = GravityModel(names, 'per_joint', found.torques, None, noise, coverage)
    rmse = np.sqrt(((samples.tau - model.predict(samples.q)) ** 2).mean(axis=0))
    return replace(model, noise=rmse, nuisance=_nuisance(found, names))


def _geometry(options: FitOptions, estimate: Estimate) -> Geometry | None:
    """Return the geometry of the options, if the model is a chain on its axes."""
    found = estimate.choice.estimate
    if not (estimate.choice.known_axes and isinstance(found, ChainEstimate)):
        return None
    return options.geometry


def _nuisance(found: ChainEstimate | SparseEstimate, names: tuple[str, ...]
              ) -> NuisanceTerms:
    regression, k = found.regression, found.regression.n_effects
    left = np.sqrt((regression.trust * found.residual() ** 2).mean(axis=0))
    return regression.nuisance.terms(names, found.beside[k:], found.covariance[k:, k:], left)


def _check(samples: JointSamples) -> None:
    if samples.n_samples < MIN_SAMPLES:
        raise FitError(f'{samples.n_samples} slow samples; a fit needs at least {MIN_SAMPLES}. '
                       f'Move longer, more slowly, or raise the speed limit of the gate')
    if at_rest(samples.q).all():
        raise FitError('no joint moves; a fit needs poses that differ')
    if not samples.tau.any():
        raise FitError('effort is 0 for every joint; does the driver publish it?')
