"""
Torque per unit of effort, from recordings without and with a known weight.

The effort of joint j is its torque divided by k_j, the N·m per unit:

    effort_j = a_j (Y_j(q) b + d_j + [loaded] W_j(m, c)) + friction_j,    a_j = 1 / k_j,

where Y are the columns of the gravity of a chain on known axes with moments b, and W is the
torque of gravity and inertia of the weight, a point of known mass m at its centre c (known
lengths). d is the small dynamic torque by the inertias of the description, if it has any. Inertia
cannot be left out of W: in slow motion it is a hundredth of the gravity torque, and as it opposes
the deviation from the middle of a swing, it changes the scale by as much.
Friction is an offset and friction that depends on the direction of motion, of each recording, and
viscous friction. Its direction is a sum of those of all laws (`effects.motion_direction`): after a
reversal friction builds up over a distance, which on a joint with little load is as large as the
effect of the weight. Torque sensors may have another offset
after a restart; without one, both recordings have the same. The masses of the arm are used for the
order of magnitude of its weight alone: the known weight gives the absolute scale, and the moments,
which all joints share, their ratios. Moments, gains and an unknown centre are fitted together by
Gauss-Newton, to means over the rows of a regression (`regression.rows`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gravity_comp_ros.data.constants import HALF_95, STANDARD_GRAVITY
from gravity_comp_ros.data.differentiation import accelerations
from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.runs import per_error
from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.description.links import DescribedArm, Inertial, on_frame
from gravity_comp_ros.effects.motion_direction import directions
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.facts.friction import without
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.applied_effects import Quantity
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.rigid_body import inverse_dynamics, PARAMETERS, regressor
from gravity_comp_ros.models.noise import correlation_times
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.rows import rows_of
import numpy as np


@dataclass(frozen=True)
class CalibrationOptions:
    """
    Options of the calibrations of efforts and servos.

    - `significance`: least size of an estimate 1 / k in standard deviations: k is then certain to
      a fifth, and its interval is symmetric.
    - `distance`, m: prior standard deviation of each coordinate of an unknown centre of mass.
    - `arm_factor`: the weight of the arm is that of the description within this factor.
      Descriptions have rough masses; a wrong mass of the known weight gives others, and exchanged
      recordings negative ones.
    - `same_offset`: whether the recordings without and with the weight have the same offset.

    :raises OptionError: if a number is not positive.
    """

    significance: float = 10.0
    distance: float = 0.2
    arm_factor: float = 10.0
    same_offset: bool = False

    def __post_init__(self) -> None:
        check_positive(self, 'calibration', 'significance', 'distance', 'arm_factor')


@dataclass(frozen=True)
class Weight:
    """
    A weight on a link: `mass` in kg, `centre` in m in the frame of the link, None if unknown.

    :raises OptionError: if the mass is not positive, or a number is not finite.
    """

    link: str
    mass: float
    centre: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.mass < np.inf:
            raise OptionError(f'the weight has a mass of {self.mass:g} kg; it must be positive')
        if self.centre is not None and not np.isfinite(self.centre).all():
            raise OptionError('the centre of mass of the weight is not finite')


@dataclass(frozen=True, eq=False)
class WeightCalibration:
    """
    The result: `scales` in N·m per unit of effort, by joint.

    `left_out` are the other joints with the reason. `load` (N·m RMS, by joint) is the gravity
    torque of the weight. `centre` is its centre of mass in m by axis. `rmse` is the residual in
    units of effort, by joint.
    """

    scales: Mapping[str, Quantity]
    left_out: Mapping[str, str]
    load: Mapping[str, float]
    centre: Mapping[str, Quantity]
    rmse: Mapping[str, float]


def calibrate(empty: JointSamples, loaded: JointSamples, arm: DescribedArm, weight: Weight,
              options: CalibrationOptions = CalibrationOptions()) -> WeightCalibration:
    """
    Return the torque per unit of effort of each joint that the weight loads.

    :raises DataError: if a recording has too few slow samples, the weight loads no joint, or the
        arm has an impossible weight.
    :raises ModelMismatchError: if the arm does not carry the link of the weight.
    """
    joints = arm.geometry.joints
    parts = [part.joints(joints) for part in (empty, loaded)]
    for name, part in zip(('without', 'with'), parts):
        if part.n_samples < FactOptions().min_slow_samples:
            raise DataError(f'the recording {name} weight has {part.n_samples} slow samples; at '
                            f'least {FactOptions().min_slow_samples} are needed')
    problem = _Problem(parts[0], parts[1], arm, weight, options)
    parameters, covariance = problem.fitted()
    result = _result(problem, joints, parameters, covariance, options)
    ratio = _arm_ratio(problem.q, arm, parameters[len(joints) + 3:])
    if not 1.0 / options.arm_factor < ratio < options.arm_factor:
        raise DataError(f'with {weight.mass:g} kg the arm would weigh {ratio:.3g} times as much '
                        f'as described: name the recording without the weight first, and check '
                        f'the mass')
    return result


def _arm_ratio(q: FloatArray, arm: DescribedArm, moments: FloatArray) -> float:
    """Return the ratio of estimated to described gravity at poses (R, N), 1 without masses."""
    inertials = arm.inertials(required=False)
    own = [inertial.about_origin()[:4] for inertial in inertials.values()]
    if not own:
        return 1.0
    described = arm.columns(q, list(inertials)) @ np.concatenate(own)
    estimated = ForwardKinematics(arm.geometry.rotations, q).moment_columns().transpose(
        2, 1, 0) @ moments
    size = float((described ** 2).sum())
    return float((estimated * described).sum()) / size if size > 0.0 else 1.0


class _Problem:
    """Efforts and columns of both recordings without offset and friction, by joint."""

    def __init__(self, empty: JointSamples, loaded: JointSamples, arm: DescribedArm,
                 weight: Weight, options: CalibrationOptions) -> None:
        samples, geometry = concatenate([empty, loaded]), arm.geometry
        self.engine = EngineOptions()
        self.rows = rows = rows_of(samples, self.engine)
        self.n, self.arm, self.weight = geometry.n_joints, arm, weight
        is_loaded = (rows.run >= empty.n_runs).astype(np.float64)
        self.q, qd = rows.mean(samples.q), rows.mean(samples.qd)
        motion = self.q, qd, rows.mean(accelerations(samples))
        # The dynamic torque is that of the described arm without the weight.
        dynamic = inverse_dynamics(geometry, *motion, geometry.inertials.ravel())
        # Of the weight by the parameters of a body in the frame of the joint that carries it.
        own = regressor(geometry, *motion, STANDARD_GRAVITY).reshape(
            *qd.shape, -1, len(PARAMETERS))[:, :, arm.place(weight.link).joint]
        self._loads = arm.columns(self.q[is_loaded > 0.0], [weight.link])
        columns = np.concatenate([
            rows.mean(samples.tau)[:, :, None],
            ForwardKinematics(geometry.rotations, self.q).moment_columns().transpose(2, 1, 0),
            dynamic[:, :, None], own * is_loaded[:, None, None]], axis=2)
        for j in range(self.n):
            offset = [np.ones(len(qd))] if options.same_offset else [1.0 - is_loaded, is_loaded]
            signs = rows.mean(directions(samples, j)).T
            friction = np.column_stack([*offset, *(signs * (1.0 - is_loaded)),
                                        *(signs * is_loaded), qd[:, j]])
            columns[:, j] = without(friction, columns[:, j])
        self.effort, self.gravity = columns[:, :, 0], columns[:, :, 1:1 + 2 * self.n]
        self.dynamic, self._own = columns[:, :, 1 + 2 * self.n], columns[:, :, 2 + 2 * self.n:]
        self.centre = np.array(weight.centre or np.zeros(3))
        self.centre_std = 1e-6 if weight.centre is not None else options.distance
        # Number of rows per independent error, at least.
        self.per_error = per_error(rows.t, rows.run, self.engine.block_seconds)

    def fitted(self) -> tuple[FloatArray, FloatArray]:
        """Return gains (N,), centre (3,) and moments (2N,) as one vector, and its covariance."""
        from scipy.optimize import least_squares  # imported here because it takes 0.3 s
        parameters, centre = self._start(), slice(self.n, self.n + 3)

        def deviation(p: FloatArray) -> FloatArray:
            """Return residual and deviation from the prior, in standard deviations."""
            return np.append(self.residual(p) / noise, (p[centre] - self.centre) / self.centre_std)

        for _ in range(self.engine.passes):
            noise = self._noise(self.residual(parameters))
            fit = least_squares(deviation, parameters, x_scale='jac', max_nfev=self.engine.steps)
            parameters = fit.x
        # Moments and gains that the motion does not excite are uncertain.
        size = np.einsum('rp,rp->p', fit.jac, fit.jac)
        return parameters, np.linalg.inv(fit.jac.T @ fit.jac + np.diag(1e-9 * size + 1e-9))

    def load(self, centre: FloatArray) -> FloatArray:
        """Return the RMS gravity torque (N,) of the weight in N·m."""
        torque = self.weight.mass * self._loads @ np.array([1.0, *centre])
        return np.asarray(np.sqrt((torque ** 2).mean(axis=0)))

    def _fixed(self, centre: FloatArray) -> FloatArray:
        """Return the torque (M, N) in N·m of inertia, and of the weight with its centre (3,)."""
        body = Inertial(self.weight.mass, centre, np.eye(3), np.zeros((3, 3)))
        return np.asarray(self.dynamic + self._own @ on_frame(self.arm, self.weight.link, body))

    def residual(self, parameters: FloatArray) -> FloatArray:
        """Return the residual (M, N) in units of effort, of gains, centre and moments."""
        gains, centre, moments = np.split(parameters, [self.n, self.n + 3])
        return np.asarray(self.effort - gains * (
            self.gravity @ moments + self._fixed(centre)))

    def _noise(self, residual: FloatArray) -> FloatArray:
        """Return the noise (N,) of independent rows of the same information, units of effort."""
        times = np.maximum(correlation_times(residual, self.rows.run), self.per_error)
        size = np.sqrt(times * (residual ** 2).mean(axis=0))
        return np.asarray(np.maximum(size, 1e-12 + 1e-6 * self.effort.std(axis=0)))

    def _start(self) -> FloatArray:
        """
        Return gains (N,), centre (3,) and moments (2N,).

        effort_j k_j = torque_j is linear in k, the moments, and a small step of the centre: from a
        wrong centre the gains may end far from the best ones. Noise of the effort makes k too
        small, so that the gain is then fitted to the torque.
        """
        load, step, n = self._fixed(self.centre), self.centre_std, self.n
        steps = [self._fixed(self.centre + step * axis) - load for axis in np.eye(3)]
        columns = np.concatenate([self.effort[:, :, None] * np.eye(n), -np.stack(steps, axis=2),
                                  -self.gravity], axis=2).reshape(load.size, -1)
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
        solution = np.linalg.lstsq(columns / size, load.ravel(), rcond=1e-6)[0] / size
        # A coordinate that the motion does not determine has any solution.
        centre = self.centre + step * np.clip(solution[n:n + 3], -3.0, 3.0)
        moments = np.asarray(solution[n + 3:])
        torque = self.gravity @ moments + self._fixed(centre)
        gains = (torque * self.effort).sum(axis=0) / np.maximum((torque ** 2).sum(axis=0), 1e-12)
        return np.concatenate([gains, centre, moments])


def _result(problem: _Problem, joints: tuple[str, ...], parameters: FloatArray,
            covariance: FloatArray, options: CalibrationOptions) -> WeightCalibration:
    std, n = np.sqrt(np.diag(covariance)), len(joints)
    loads = problem.load(parameters[n:n + 3])
    scales, left_out = {}, {}
    for joint, gain, error, load in zip(joints, parameters, std, loads):
        if abs(gain) < options.significance * error or load < 1e-3 * loads.max():
            left_out[joint] = 'its effort depends too little on the load in this motion'
            continue
        scales[joint] = Quantity.around(1.0 / gain, 'N·m per unit', HALF_95 * error / gain ** 2)
    if not scales:
        raise DataError('the weight changes the effort of no joint: is it in the second '
                        'recording, and does the arm move with it?')
    return WeightCalibration(
        scales, left_out, dict(zip(joints, loads.tolist())),
        {axis: Quantity.around(x, 'm', HALF_95 * s)
         for axis, x, s in zip('xyz', parameters[n:], std[n:])},
        dict(zip(joints, problem.residual(parameters).std(axis=0).tolist())))
