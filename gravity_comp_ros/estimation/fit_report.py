"""Fit report: errors, fitted effects, the choice of the formulation, and warnings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.predict import static_std
from gravity_comp_ros.estimation.estimate import Estimate, FitOptions
from gravity_comp_ros.estimation.estimated_model import is_absorbed, target_of
from gravity_comp_ros.estimation.robust import Outliers, outliers
from gravity_comp_ros.models.applied_effects import Applied
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import zero_angle_differences
from gravity_comp_ros.models.sparse.dictionary import at_rest
from gravity_comp_ros.models.sparse.sparse_fit import SparseFit
from gravity_comp_ros.printable import counted
from gravity_comp_ros.regression.vertical import base_tilt_angle, MAX_FITTED_TILT
import numpy as np
from numpy.typing import NDArray

# Minimum zero-angle offset and tilt of the base, in rad, that are reported, and minimum
# zero-angle offset in standard deviations.
_MIN_ANGLE, _SIGNIFICANT = np.radians(0.3), 3.0
# Minimum tilt of the base, in rad, of an arm that counts as mounted upside down.
_UPSIDE_DOWN = np.radians(135.0)
# Standard deviation of the torque over the whole range, as a share of the largest torque, above
# which the model warns of poses away from the trained ones.
_UNCERTAIN = 0.02


@dataclass(frozen=True, eq=False)
class FitDetails:
    """
    The report of a fit.

    `why` is the reason of the formulation, `held_out` are held-out errors by formulation in
    multiples of the noise, empty without a comparison.
    By joint: the number of `features`; `rmse` in N·m of the model's prediction, `noise` in N·m
    with all fitted effects. `n_fitted` is the number of rows of the regression, `steps` that of
    the last linearisations. `white` tells whether the residual is close to white noise. `solver`
    are the L1 problems. The axes are known (`known_axes`) or estimated. `base_tilt` in rad is the
    angle of the fitted vertical to that of known axes; `zero_angles` in rad by joint is the true
    minus the reported angle. `std_over_poses` in N·m is the prediction std over the whole joint
    range, empty without an uncertainty. `outliers` by joint have a reduced weight in the fit.
    """

    formulation: str
    why: str
    held_out: Mapping[str, float]
    n_samples: int
    n_runs: int
    n_fitted: int
    features: Mapping[str, int]
    rmse: Mapping[str, float]
    noise: Mapping[str, float]
    fitted: Applied
    solver: tuple[SparseFit, ...]
    dropped_joints: tuple[str, ...]
    warnings: tuple[str, ...]
    white: bool
    steps: int
    known_axes: bool
    base_tilt: float
    zero_angles: Mapping[str, float]
    std_over_poses: Mapping[str, float]
    outliers: Mapping[str, Outliers]

    def to_json(self) -> dict[str, Any]:
        """Return the report for a model's provenance and for `fit --json`."""
        return {
            'formulation': self.formulation, 'why': self.why, 'held_out': dict(self.held_out),
            'n_samples': self.n_samples, 'n_runs': self.n_runs, 'n_fitted': self.n_fitted,
            'features': dict(self.features), 'rmse': dict(self.rmse), 'noise': dict(self.noise),
            'fitted': [{'target': e.target, **asdict(e)} for e in self.fitted.effects],
            'solver': [_solver_json(each) for each in self.solver],
            'dropped_joints': list(self.dropped_joints), 'warnings': list(self.warnings),
            'white': self.white, 'steps': self.steps, 'known_axes': self.known_axes,
            'base_tilt': self.base_tilt, 'zero_angles': dict(self.zero_angles),
            'std_anywhere': dict(self.std_over_poses),
            'outliers': {name: asdict(each) for name, each in self.outliers.items()}}


def build_report(model: GravityModel, estimate: Estimate, options: FitOptions
                 ) -> FitDetails:
    """
    Return the report of a fit.

    :param options: of the fit, with the axes of the description on its own vertical.
    """
    regression = estimate.regression
    problem = regression.problem
    used = problem.measured.select(problem.used)
    dropped = tuple(name for name, still in zip(used.names, at_rest(used.q)) if still)
    known, tilt, zeros, described = model.geometry is not None, 0.0, {}, options.geometry
    if known and described is not None and model.chain is not None:
        tilt = base_tilt_angle(described.rotations, model.chain.axes)
        tilt = tilt if tilt > _MIN_ANGLE else 0.0
        zeros = dict(zip(used.names[1:], zero_angle_differences(
            described.rotations, model.chain.axes)[1:].tolist()))
        limits = _zero_angle_limits(estimate)
        zeros = {name: angle for name, angle in zeros.items() if abs(angle) > limits[name]}
    anywhere = std_over_poses(model)
    spoilt = outliers(problem.means(problem.y), problem.n_measured,
                      regression.posterior.unweighted_residual())

    def by_joint(values: NDArray[Any]) -> dict[str, Any]:
        return dict(zip(model.joints, values.tolist()))

    lines = [estimate.warning, *_tilt_warning(tilt), *_zero_angle_warning(zeros),
             *_outlier_warnings(spoilt), *_warnings(model, estimate, dropped),
             *uncertainty_warning(model, anywhere, problem.scale.largest)]
    return FitDetails(
        model.formulation, estimate.why, estimate.held_out, used.n_samples, used.n_runs,
        problem.rows.n_rows, by_joint(model.n_features()),
        by_joint(model.noise), by_joint(model.noise_with_nuisance), model.fitted, estimate.fits,
        dropped, tuple(line for line in lines if line), regression.is_white(options.white),
        regression.steps, known, tilt, zeros, by_joint(anywhere) if anywhere.size else {},
        spoilt)


def _zero_angle_limits(estimate: Estimate) -> Mapping[str, float]:
    """Return the smallest zero-angle offset in rad of each joint that is reported."""
    regression = estimate.regression
    names = regression.problem.samples.names
    # The tilt of the base is before the zero angles (`regression.known_axes`).
    variance = np.diag(regression.posterior.covariance)[2:2 + len(names)]
    limits = np.maximum(_MIN_ANGLE, _SIGNIFICANT * np.sqrt(np.maximum(variance, 0.0)))
    return dict(zip(names, limits.tolist()))


def std_over_poses(model: GravityModel) -> FloatArray:
    """Return each joint's standard deviation (N,) in N·m, RMS over all poses; (0,) if unknown."""
    if model.covariance is None:
        return np.zeros(0)
    std = static_std(model, random_poses(model.n_joints))
    return np.asarray(np.sqrt((std ** 2).mean(axis=0)))


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


def fitted_sentence(model: GravityModel) -> str | None:
    """Return one sentence on the fitted effects, None without any."""
    joints: dict[str, set[str | None]] = {}
    for effect in model.fitted.effects:
        joints.setdefault(effect.name, set()).add(effect.joint)
    if not joints:
        return None
    parts = [name if None in where else f'{name} on {counted(len(where), "joint")}'
             for name, where in joints.items()]
    listed = parts[0] if len(parts) == 1 else ', '.join(parts[:-1]) + ' and ' + parts[-1]
    return f'fitted jointly with gravity and not predicted: {listed}'


def _solver_json(fit: SparseFit) -> dict[str, Any]:
    solution = fit.lasso
    return {'lambda': solution.lam, 'iterations': solution.iterations,
            'rounds': fit.rounds, 'working_set': solution.working_set,
            'l1_support': len(solution.indices), 'support': len(fit.indices),
            'ties': fit.n_equivalent, 'inflation': fit.inflation,
            'converged': solution.converged,
            **asdict(solution.certificate)}


def _outlier_warnings(spoilt: Mapping[str, Outliers]) -> list[str]:
    return [f'outliers with reduced weight: {counted(each.n, "sample")} of {name}, {each}'
            for name, each in spoilt.items()]


def _warnings(model: GravityModel, estimate: Estimate, dropped: tuple[str, ...]) -> list[str]:
    lines = []
    if dropped:
        lines.append(f'{", ".join(dropped)} never moved: the model is valid only at that angle')
    if not any(torque.indices.size for torque in model.torques):
        lines.append('no torque differs from noise: the model is 0 everywhere. If gravity does '
                     'load the arm, record more poses')
    absorbed = [target_of(term, model.joints) for term in estimate.regression.terms
                if is_absorbed(estimate, term)]
    if absorbed:
        lines.append(f'this motion does not separate {", ".join(absorbed)} from gravity: their '
                     f'sum with gravity is predicted. Move the other joints as well')
    if not estimate.regression.converged:
        lines.append('the axes have not converged: record more poses' + (
            '' if model.geometry else ', or name a robot description with --urdf'))
    if not all(fit.lasso.converged for fit in estimate.fits):
        lines.append('ADMM did not reach its tolerance; its residuals are in the report')
    return lines


def uncertainty_warning(model: GravityModel, std: FloatArray, largest: float) -> list[str]:
    """
    Return a warning if the error outside the trained poses may be large.

    :param std: of `std_over_poses`. :param largest: torque scale of the arm, N·m.
    """
    if not std.size:
        return []
    worst = int(np.argmax(std))
    if std[worst] < _UNCERTAIN * largest:
        return []
    return [f'away from the trained poses the torque of {model.joints[worst]} may be off by '
            f'{HALF_95 * std[worst]:.2g} N·m (95 %). Record more poses, further apart']
