"""
Gravity estimator: from samples to a gravity model and a fit report.

Friction and offset of each joint, and inertia in fast motion, are fitted jointly with gravity as
nuisance terms (`models.nuisance`). Outliers have reduced weights (`estimation.robust`), and long
recordings are condensed (`data.condense`). `fit`, `add`, `update`, the diagnosis, the node, the
workbench and the fleet use this estimator.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from gravity_comp_ros.data.acceleration import accelerations
from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.data.velocity_check import checked_velocity
from gravity_comp_ros.errors import FitError, ModelMismatchError, OptionError
from gravity_comp_ros.estimation.chain_estimate import ChainEstimate, estimate_chain
from gravity_comp_ros.estimation.fit_report import build_report, FitDetails
from gravity_comp_ros.estimation.formulation_choice import Choice, choose
from gravity_comp_ros.estimation.inertia import is_fast
from gravity_comp_ros.estimation.nominal_motion import without_motion
from gravity_comp_ros.estimation.regression import build_regression, Regression
from gravity_comp_ros.estimation.sparse_estimate import estimate_sparse, SparseEstimate
from gravity_comp_ros.models.gravity_model import Coverage, FORMULATIONS, GravityModel
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.vertical import with_estimated_vertical
from gravity_comp_ros.models.kinematic.zero_angles import with_zero_angles
from gravity_comp_ros.models.nuisance import NuisanceTerms, OFFSET
from gravity_comp_ros.models.sparse.identifiability import at_rest
from gravity_comp_ros.models.sparse.sparse_problem import SparseOptions
from gravity_comp_ros.models.uncertainty import ChainUncertainty, EnergyUncertainty
import numpy as np

MIN_SAMPLES = 10
# Maximum number of samples that zero angles are fitted to.
_MAX_ZERO_ANGLE_SAMPLES = 600
# Formulations to choose from; `auto` chooses between chain and potential by the data.
CHOICES = ('auto', *FORMULATIONS)

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class FitOptions:
    """
    Options of a fit: the `formulation`, and how its sparse problems are solved.

    `auto` fits the chain, and the potential if that predicts held-out samples better; the report
    contains the choice and the reason. With a `geometry` the axes of the chain are known and only
    its moments are fitted; the samples' joints must be in its order.

    :raises OptionError: if the formulation is unknown, or does not use a geometry.
    """

    formulation: str = 'auto'
    sparse: SparseOptions = SparseOptions()
    geometry: Geometry | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if self.formulation not in CHOICES:
            raise OptionError(f'unknown formulation {self.formulation!r}; choose from '
                              f'{", ".join(CHOICES)}')
        if self.geometry is not None and self.formulation not in ('chain', 'auto'):
            raise OptionError(f'formulation {self.formulation} does not use known axes; choose '
                              f'chain or auto')

    def known_axes(self, samples: JointSamples) -> FloatArray | None:
        """
        Return the known axes (N, 3, 3), None without a geometry.

        :raises ModelMismatchError: if they are of other joints, or in another order.
        """
        if self.geometry is None:
            return None
        if self.geometry.joints != samples.names:
            raise ModelMismatchError(f'the known axes are of {", ".join(self.geometry.joints)}, '
                                     f'but the samples are of {", ".join(samples.names)}')
        return self.geometry.rotations

    def to_json(self) -> dict[str, Any]:
        """Return the options for a model's provenance."""
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

    def with_warning(self, warning: str) -> FitResult:
        """Return the same with another first warning, in the report and in the provenance."""
        warnings, provenance = (warning, *self.report.warnings), self.model.provenance
        provenance = {**provenance,
                      'report': {**provenance['report'], 'warnings': list(warnings)}}
        return replace(self, report=replace(self.report, warnings=warnings),
                       model=replace(self.model, provenance=provenance))


@dataclass(frozen=True, eq=False)
class Estimate:
    """
    An estimate of gravity: the `choice` of a formulation, and its regression.

    `effects` (K,) and `covariance` (K, K) are the coefficients of the regression's effects.
    """

    choice: Choice
    regression: Regression
    effects: FloatArray
    covariance: FloatArray


def fit(samples: JointSamples, options: FitOptions = FitOptions(),
        progress: Progress | None = None, old: GravityModel | None = None) -> FitResult:
    """
    Learn the gravity torque from samples.

    :param samples: slow motion, or motion of any speed: inertia is then a nuisance term. In slow
        motion it is one if the accelerations of the samples are known.
    :param progress: called with a word and a share from 0 to 1.
    :param old: a model of the same joints as the start of the search; it is no constraint.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises ModelMismatchError: if the options have the axes of other joints.
    """
    _check(samples)
    if progress:
        progress('fit', 0.0)
    samples, warning = checked_velocity(samples)
    described = options.geometry
    if options.known_axes(samples) is not None and described is not None:
        options = replace(options, geometry=_fitted_geometry(described, samples))
    estimate = _estimate(samples, options, old)
    model = gravity_model(estimate, samples)
    report = build_report(model, samples, estimate.choice, estimate.regression, warning,
                          described)
    gravity = estimate.choice.estimate
    on_axes = estimate.choice.known_axes and isinstance(gravity, ChainEstimate)
    model = replace(model, geometry=options.geometry if on_axes else None,
                    provenance={'options': options.to_json(), 'report': report.to_json()})
    if progress:
        progress('fit', 1.0)
    converged = isinstance(gravity, ChainEstimate) or all(
        each.lasso.converged for each in gravity.fits)
    return FitResult(model, report, converged)


def _fitted_geometry(geometry: Geometry, samples: JointSamples) -> Geometry:
    """
    Return the geometry with the vertical and the zero angles fitted to the torque.

    Zero angles are not fitted to fast motion: they would absorb the dynamic torque that the
    nominal arm does not model.
    """
    geometry = with_estimated_vertical(geometry, samples)
    if is_fast(samples):
        return geometry
    rows = evenly_picked(samples.n_samples, _MAX_ZERO_ANGLE_SAMPLES)
    qdd = accelerations(samples)[rows]
    return with_zero_angles(geometry, without_motion(samples.select(rows), geometry, qdd))


def _estimate(samples: JointSamples, options: FitOptions, old: GravityModel | None) -> Estimate:
    """Return gravity, fitted with the dynamic torque of the nominal arm subtracted."""
    estimate = estimate_gravity(build_regression(samples, geometry=options.geometry), options, old)
    if not estimate.choice.warning:
        return estimate
    # The axes were rejected, so the dynamic torque computed from them was wrong as well.
    return estimate_gravity(build_regression(samples), options, old)


def estimate_gravity(regression: Regression, options: FitOptions,
                     old: GravityModel | None = None, known: FloatArray | None = None,
                     warm: bool = False) -> Estimate:
    """
    Estimate gravity jointly with the linear terms of a regression.

    :param known: axes (N, 3, 3) that need no search; those of the options if not given.
    :param warm: whether the chain of `old` is the only start of the search.
    :raises FitError: if there are no samples.
    :raises ModelMismatchError: if the options have the axes of other joints.
    """
    samples, formulation = regression.samples, options.formulation
    usable = old if old is not None and old.joints == samples.names else None
    known = options.known_axes(samples) if known is None else known
    start = usable.chain if usable is not None else None
    if formulation == 'auto':
        no_offsets = usable is not None and start is not None and not any(
            term.kind == OFFSET for term in usable.nuisance.terms)
        choice = choose(regression, options.sparse, known, start, warm, no_offsets)
    elif formulation == 'chain':
        choice = Choice(estimate_chain(regression, known, start, warm), 'it was requested', {},
                        known is not None)
    else:
        from_chain = regression.has_coupled_inertia and formulation == 'potential'
        if from_chain:
            # Inertia has N columns a joint; the fit of a chain selects the significant ones.
            regression = estimate_chain(regression, start=start).regression
        before = None if usable is None or usable.formulation != formulation else (
            usable.energy if formulation == 'potential' else usable.torques)
        choice = Choice(estimate_sparse(regression, formulation, options.sparse, before,
                                        from_chain), 'it was requested')
    gravity, k = choice.estimate, regression.n_effects
    return Estimate(choice, gravity.regression, gravity.coefficients[:k],
                    gravity.covariance[:k, :k])


def gravity_model(estimate: Estimate, samples: JointSamples) -> GravityModel:
    """
    Return the model of an estimate; its noise is the RMSE of its prediction of `samples`.

    :param samples: all fitted samples, before condensing.
    """
    gravity, names = estimate.choice.estimate, samples.names
    coverage = Coverage.of(samples)
    noise = np.zeros(samples.n_joints)
    if isinstance(gravity, ChainEstimate):
        chain = gravity.chain
        model = GravityModel.from_energy(names, 'chain', expand(chain), noise, coverage, {}, chain,
                                         ChainUncertainty(chain, gravity.fit.covariance))
    elif gravity.energy is not None:
        model = GravityModel.from_energy(
            names, 'potential', gravity.energy, noise, coverage, {},
            uncertainty=EnergyUncertainty(gravity.energy.indices, gravity.fits[0].covariance))
    else:
        model = GravityModel(names, 'per_joint', gravity.torques, None, noise, coverage)
    rmse = np.sqrt(((samples.tau - model.predict(samples.q)) ** 2).mean(axis=0))
    return replace(model, noise=rmse, nuisance=_nuisance(gravity, names))


def _nuisance(gravity: ChainEstimate | SparseEstimate, names: tuple[str, ...]) -> NuisanceTerms:
    regression, k = gravity.regression, gravity.regression.n_effects
    noise = np.sqrt((regression.robust_weights * gravity.residual() ** 2).mean(axis=0))
    return regression.nuisance.terms(names, gravity.coefficients[k:], gravity.covariance[k:, k:],
                                     noise)


def _check(samples: JointSamples) -> None:
    if samples.n_samples < MIN_SAMPLES:
        raise FitError(f'{samples.n_samples} slow samples; a fit needs at least {MIN_SAMPLES}. '
                       f'Record longer or slower motion, or raise the speed limit of the gate')
    if at_rest(samples.q).all():
        raise FitError('no joint moves; a fit needs poses that differ')
    if not samples.tau.any():
        raise FitError('effort is 0 for every joint; check that the driver publishes it')
