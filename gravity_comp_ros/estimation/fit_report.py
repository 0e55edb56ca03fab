"""Fit report: prediction errors, noise, nuisance terms, and warnings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.estimation.chain_estimate import ChainEstimate
from gravity_comp_ros.estimation.formulation_choice import Choice
from gravity_comp_ros.estimation.regression import Regression
from gravity_comp_ros.estimation.robust import excluded_samples, ExcludedSamples
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.alternative_chains import (
    least_certain_joint, std_over_poses)
from gravity_comp_ros.models.kinematic.chain_fit import ChainFit
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.vertical import base_tilt_angle, MAX_FITTED_TILT
from gravity_comp_ros.models.kinematic.zero_angles import zero_angle_differences
from gravity_comp_ros.models.nuisance import (
    COULOMB, INERTIA, NuisanceTerm, NuisanceTerms, OFFSET, VISCOUS)
from gravity_comp_ros.models.sparse.identifiability import at_rest
from gravity_comp_ros.models.sparse.sparse_problem import SparseFit
from gravity_comp_ros.printable import counted
import numpy as np
from numpy.typing import NDArray

# Minimum zero-angle offset, in rad, that is reported.
_MIN_ZERO_ANGLE = np.radians(0.1)
# Minimum tilt of the base, in rad, of an arm that counts as mounted upside down.
_UPSIDE_DOWN = np.radians(135.0)


@dataclass(frozen=True)
class FormulationChoice:
    """
    The chosen formulation and the reason; `held_out` are errors in multiples of the noise.

    `warning` is the reason why known axes were rejected, '' if they were not.
    """

    formulation: str
    why: str
    held_out: Mapping[str, float]
    warning: str = ''

    def to_json(self) -> dict[str, Any]:
        """Return the choice for a report, whose warnings include this warning."""
        return {'formulation': self.formulation, 'why': self.why, 'held_out': dict(self.held_out)}


@dataclass(frozen=True, eq=False)
class FitDetails:
    """
    The report of a fit.

    By joint: the number of `features`; `rmse` in N·m of the model's prediction; the noise with
    all terms included, `noise` in N·m and `relative_noise` as a share of the torque; excluded
    samples `set_aside`. `solver` are the L1 problems; `chain` is None for other formulations,
    and its axes are known (`known_axes`) or from a search. `base_tilt` in rad is the angle of
    the fitted vertical to that of known axes; `zero_angles` in rad by joint is the true minus the
    reported angle. `std_over_poses` in N·m is the prediction std over the whole joint range.
    """

    formulation: str
    choice: FormulationChoice
    n_samples: int
    n_runs: int
    n_fitted: int
    features: Mapping[str, int]
    rmse: Mapping[str, float]
    noise: Mapping[str, float]
    relative_noise: Mapping[str, float]
    nuisance: tuple[NuisanceTerm, ...]
    set_aside: Mapping[str, ExcludedSamples]
    solver: tuple[SparseFit, ...]
    dropped_joints: tuple[str, ...]
    warnings: tuple[str, ...]
    chain: ChainFit | None
    known_axes: bool
    base_tilt: float
    zero_angles: Mapping[str, float]
    std_over_poses: Mapping[str, float]

    def to_json(self) -> dict[str, Any]:
        """Return the report for a model's provenance and for `fit --json`."""
        return {
            'formulation': self.formulation, 'choice': self.choice.to_json(),
            'n_samples': self.n_samples, 'n_runs': self.n_runs, 'n_fitted': self.n_fitted,
            'features': dict(self.features), 'rmse': dict(self.rmse),
            'noise': {'absolute': dict(self.noise), 'relative': dict(self.relative_noise)},
            'nuisance': [_nuisance_json(term) for term in self.nuisance],
            'set_aside': {name: asdict(lost) for name, lost in self.set_aside.items()},
            'solver': [_solver_json(each) for each in self.solver],
            'dropped_joints': list(self.dropped_joints), 'warnings': list(self.warnings),
            **({} if self.chain is None else {'chain': {
                'known_axes': self.known_axes, 'base_tilt': self.base_tilt,
                'zero_angles': dict(self.zero_angles),
                **_chain_json(self.chain),
                'std_anywhere': dict(self.std_over_poses)}})}


def build_report(model: GravityModel, samples: JointSamples, choice: Choice,
                 regression: Regression, warning: str = '',
                 described: Geometry | None = None) -> FitDetails:
    """
    Return the report of a fit.

    :param described: the axes of the description, on its own vertical.
    :param warning: the first of the warnings.
    """
    gravity = choice.estimate
    chain = gravity.fit if isinstance(gravity, ChainEstimate) else None
    fits = [] if isinstance(gravity, ChainEstimate) else gravity.fits
    noises = [chain.noise] if chain else [each.noise for each in fits]
    dropped = tuple(name for name, still in zip(samples.names, at_rest(samples.q)) if still)
    excluded = excluded_samples(regression.samples, regression.robust_weights)
    tilt, zeros = 0.0, {}
    if chain and choice.known_axes and described is not None:
        tilt = base_tilt_angle(described.rotations, chain.chain.axes)
        zeros = dict(zip(samples.names[1:], zero_angle_differences(
            described.rotations, chain.chain.axes)[1:].tolist()))
        zeros = {name: angle for name, angle in zeros.items() if abs(angle) > _MIN_ZERO_ANGLE}
    lines = [warning, choice.warning, *_tilt_warning(tilt), *_zero_angle_warning(zeros),
             *_warnings(samples, model, chain, fits, dropped, excluded)]

    def by_joint(values: NDArray[Any]) -> dict[str, Any]:
        return dict(zip(model.joints, values.tolist()))

    return FitDetails(
        model.formulation,
        FormulationChoice(choice.formulation, choice.why, choice.held_out, choice.warning),
        samples.n_samples, samples.n_runs, regression.samples.n_samples,
        by_joint(model.n_features()), by_joint(model.noise),
        by_joint(np.concatenate([each.absolute for each in noises])),
        by_joint(np.concatenate([each.relative for each in noises])),
        model.nuisance.terms, excluded, tuple(fits), dropped,
        tuple(line for line in lines if line), chain, choice.known_axes, tilt, zeros,
        by_joint(std_over_poses(chain.chain, chain.covariance)) if chain else {})


def _tilt_warning(tilt: float) -> list[str]:
    """Return a warning if the base is tilted against the description, as on a wall."""
    if tilt < MAX_FITTED_TILT:
        return []
    line = (f'the base is tilted by {np.degrees(tilt):.1f} degrees against the description: '
            f'gravity is fitted along the vertical estimated from the torque')
    if tilt > _UPSIDE_DOWN:
        line += '. Check whether the arm hangs from a ceiling or its effort has the opposite sign'
    return [line]


def _zero_angle_warning(angles: Mapping[str, float]) -> list[str]:
    """Return a warning if zero angles differ from those of the description."""
    if not angles:
        return []
    named = ', '.join(f'{name} by {np.degrees(angle):.1f}' for name, angle in angles.items())
    return [f'the zero angles differ from those of the description (encoder offsets, true minus '
            f'reported angle, in degrees: {named}): gravity is fitted with zero angles estimated '
            f'from the torque. Calibrate the encoders, or correct the description']


def _nuisance_json(term: NuisanceTerm) -> dict[str, Any]:
    """Return a nuisance term with its 95 % interval."""
    return {'effect': term.kind, 'joint': term.joint, 'value': term.value, 'unit': term.unit,
            'ci95': [term.value - 1.96 * term.std, term.value + 1.96 * term.std],
            **({'acceleration_of': term.source} if term.source else {})}


def nuisance_sentence(nuisance: NuisanceTerms) -> str | None:
    """Return one sentence on the nuisance terms, None without any."""
    parts = []
    for kinds, word in (((COULOMB, VISCOUS), 'friction'), ((OFFSET,), 'an offset'),
                        ((INERTIA,), 'inertia')):
        joints = {term.joint for term in nuisance.terms if term.kind in kinds}
        if joints:
            parts.append(f'{word} on {counted(len(joints), "joint")}')
    if not parts:
        return None
    listed = parts[0] if len(parts) == 1 else ', '.join(parts[:-1]) + ' and ' + parts[-1]
    return f'fitted jointly with gravity and not predicted: {listed}'


def _solver_json(fit: SparseFit) -> dict[str, Any]:
    solution = fit.lasso
    return {'lambda': solution.lam, 'iterations': solution.iterations,
            'rounds': fit.rounds, 'working_set': solution.working_set,
            'l1_support': len(solution.indices), 'support': len(fit.indices),
            'ties': fit.n_averaged, 'inflation': fit.inflation,
            'converged': solution.converged,
            **asdict(solution.certificate)}


def _chain_json(chain: ChainFit) -> dict[str, Any]:
    return {'starts': chain.starts, 'steps': chain.steps, 'structure': chain.structure,
            'clean': chain.clean, 'right_angles': list(chain.square),
            'rivals': chain.rivals, 'inflation': chain.inflation.tolist()}


def _warnings(samples: JointSamples, model: GravityModel, chain: ChainFit | None,
              fits: list[SparseFit], dropped: tuple[str, ...],
              excluded: Mapping[str, ExcludedSamples]) -> list[str]:
    lines = []
    if dropped:
        lines.append(f'{", ".join(dropped)} never moved: the model is valid only at that angle')
    if not any(torque.indices.size for torque in model.torques):
        lines.append('no torque differs from noise: the model is 0 everywhere. If gravity does '
                     'load the arm, record more poses')
    for name, lost in excluded.items():
        lines.append(f'excluded as outliers: {counted(lost.n, "sample")} of {name}, {lost}')
    if chain:
        lines += _structure(model, chain) + _uncertainty(samples, model, chain)
    if not all(fit.lasso.converged for fit in fits):
        lines.append('ADMM did not reach its tolerance; its residuals are in the report')
    ambiguous = sum(fit.n_averaged for fit in fits)
    if ambiguous:
        lines.append(f'{counted(ambiguous, "feature")} not identifiable: nearly collinear with '
                     f'another one on this motion; their average is used. Record a wider motion')
    return lines


def _structure(model: GravityModel, chain: ChainFit) -> list[str]:
    if chain.clean or model.nuisance.terms:
        return []
    return [f'the residual of the chain is not white ({chain.structure:.1f} standard deviations): '
            f'an effect is not modelled, or the arm is no serial chain']


def _uncertainty(samples: JointSamples, model: GravityModel, chain: ChainFit) -> list[str]:
    """Return a warning if the chain's error outside its training may be large."""
    sigma = np.sqrt((chain.noise.sigma(chain.chain.torque(samples.q)) ** 2).mean(axis=0))
    joint = least_certain_joint(chain.chain, chain.covariance, np.maximum(sigma, 1e-9))
    if joint is None:
        return []
    std: FloatArray = std_over_poses(chain.chain, chain.covariance)
    others = f'; {chain.rivals} other chains explain these samples nearly as well' \
        if chain.rivals > 1 else '; another chain explains these samples nearly as well' \
        if chain.rivals else ''
    return [f'away from the trained poses the torque of {model.joints[joint]} may be off by '
            f'{1.96 * std[joint]:.2g} N·m (95 %){others}. Record more poses, further apart']
