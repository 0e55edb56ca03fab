"""
Gains of the joints' efforts that contradict one arm: other units, rated torques, gear ratios.

The torques of all joints come from the same moments, seen through the axes (`ArmFit`). The
differences of the logarithms of the gains are identified where two joints carry the same link at
several poses; their common part is a unit of the moments. A joint without gravity of its own, such
as the first of a level arm, has no identified gain, but for its friction and inertia in an earlier
model. The search has several gains at the start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.effects.offset import TorqueGain
from gravity_comp_ros.effects.predict import fitted_torque, predict_torque
from gravity_comp_ros.estimation.arm_fit import ArmFit, MANY
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.facts.fact import Action, Fact, Kind, listed, TIMES_GIVEN
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.arm_solver import cost_of
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np

# Samples whose friction is compared with that of an earlier model.
_SAMPLES = 4000


@dataclass(frozen=True)
class JointGains:
    """
    Gains relative to the joint `reference`.

    `log` and `std` (N,) are the logarithm and its standard deviation, `residual` (N,) the share of
    a joint's effort that remains. Gains that differ are `established` or not. The gains of
    `by_friction` are those of friction and inertia.
    """

    names: tuple[str, ...]
    reference: int
    log: FloatArray
    std: FloatArray
    residual: FloatArray
    established: bool
    by_friction: frozenset[int] = frozenset()

    def relative_to(self, model: GravityModel, samples: JointSamples) -> JointGains:
        """
        Return the gains relative to the joint whose effort is most like that of an earlier model.

        Joints without an identified gain have that of their friction and inertia in the model.
        """
        known = (self.std < np.log(OPTIONS.min_ratio)) & (self.residual < OPTIONS.max_residual)
        change, rest = friction_gains(model, samples)
        agrees = (known & (rest < OPTIONS.max_residual)
                  & (self.residual <= OPTIONS.max_reference))
        best = int(np.argmin(np.where(agrees, np.abs(change), np.inf))
                   ) if agrees.any() else self.reference
        own = self.log - _log_gains(model)
        std = np.where(known, np.hypot(self.std, self.std[best]), OPTIONS.friction)
        std[best] = 0.0
        return replace(self, reference=best, std=std,
                       log=np.where(known, own - own[best], change - change[best]),
                       residual=np.where(known, self.residual, rest),
                       by_friction=frozenset(np.flatnonzero(~known).tolist()))

    def facts(self, min_ratio: float = OPTIONS.min_ratio) -> list[Fact]:
        """
        Return the fact that gains disagree, if they do.

        :param min_ratio: of gains that are refused.
        """
        if not self.established:
            return []
        clear = ((np.abs(self.log) > OPTIONS.sigmas * self.std)
                 & (self.residual < OPTIONS.max_residual))
        refused, named = (np.flatnonzero(clear & (np.abs(self.log) > np.log(ratio)))
                          for ratio in (min_ratio, OPTIONS.min_error))
        joints = [int(n) for n in named]
        if (not set(refused) - self.by_friction
                or self.residual[self.reference] > OPTIONS.max_reference):
            return []
        ratios = {self.names[n]: float(np.exp(self.log[n])) for n in joints}
        scales = ','.join(f'{name}={1.0 / ratio:.3g}' for name, ratio in ratios.items())
        agree = [name for n, name in enumerate(self.names) if n != self.reference
                 and n not in joints and OPTIONS.sigmas * self.std[n] < np.log(min_ratio)]
        also = f'; {", ".join(agree)} agree{"s" * (len(agree) == 1)}' if agree else ''
        unit = self.names[self.reference]
        parts = [self._ratio(n, f' the gain of {unit}' * (n == joints[0])) for n in joints]
        return [Fact(
            Kind.EFFORT_GAIN, tuple(ratios), f'gains disagree: {", ".join(parts)}{also}',
            Action.REFUSED, 'the weight of the same links loads these joints, so that units, '
            'rated torques, gear ratios or torque constants differ',
            f'--effort-scale {scales} {TIMES_GIVEN} converts to the unit of {unit}; '
            f'--accept {Kind.EFFORT_GAIN} keeps them', ratios)]

    def _ratio(self, n: int, of_what: str) -> str:
        low, ratio, high = np.exp(self.log[n] + self.std[n] * np.array([-HALF_95, 0.0, HALF_95]))
        how = ', by its friction and inertia' if n in self.by_friction else ''
        return (f'{self.names[n]} has {ratio:.3g} times{of_what} '
                f'(95 %: {low:.3g} to {high:.3g}{how})')


def _log_gains(model: GravityModel) -> FloatArray:
    """Return the logarithms (N,) of the gains that the effects of a model have."""
    log = np.zeros(model.n_joints)
    for effect in (*model.applied.effects, *model.fitted.effects):
        if effect.name == TorqueGain.name and effect.joint is not None:
            log[model.joints.index(effect.joint)] = np.log1p(effect.coefficients['k'].value)
    return log


def friction_gains(model: GravityModel, samples: JointSamples) -> tuple[FloatArray, FloatArray]:
    """
    Return the logarithms (N,) of the gains of the efforts relative to an earlier model.

    They are those of friction and inertia, while gravity is free: a body changes gravity alone.
    Also the share (N,) of a joint's effort without gravity that they do not explain.
    """
    samples = samples.select(evenly_picked(len(samples), _SAMPLES))
    gravity = model.predict(samples.q)
    friction = predict_torque(model, samples) + fitted_torque(model, samples) - gravity
    columns = gravity.T[None] if model.chain is None else ForwardKinematics(
        model.chain.axes, samples.q).moment_columns()
    slope, rest = np.zeros((2, samples.n_joints))
    for n in range(samples.n_joints):
        own = np.column_stack([np.ones(len(samples)), columns[:, n].T])
        both = np.column_stack([friction[:, n], samples.tau[:, n]])
        torque, effort = (both - own @ lstsq(own, both)).T
        slope[n] = torque @ effort / max(float(torque @ torque), 1e-18)
        rest[n] = (effort - slope[n] * torque).std() / max(float(effort.std()), 1e-18)
    return np.log(np.maximum(slope, 1e-9)), rest


def common_gain(model: GravityModel, samples: JointSamples) -> list[Fact]:
    """Return the fact that the efforts of all joints have one other gain than in a model."""
    change, rest = friction_gains(model, samples)
    explained = rest < OPTIONS.max_residual
    if 2 * explained.sum() < max(len(change), 3):
        return []
    common = float(np.median(change[explained]))
    if (abs(common) < np.log(OPTIONS.min_ratio)
            or np.abs(change[explained] - common).max() > np.log(OPTIONS.min_ratio)):
        return []
    ratio = float(np.exp(common))
    names = [name for name, one in zip(samples.names, explained) if one]
    scales = ','.join(f'{name}={1.0 / ratio:.3g}' for name in samples.names)
    return [Fact(
        Kind.EFFORT_GAIN, tuple(names), f'the efforts of {listed(names, len(samples.names))} are '
        f'{ratio:.3g} times those of the earlier model, with friction', Action.REFUSED,
        'the unit of effort differs', f'--effort-scale {scales} {TIMES_GIVEN} converts to '
        f'that of the model; --accept {Kind.EFFORT_GAIN} keeps them', dict.fromkeys(names, ratio))]


def joint_gains(fit: ArmFit) -> JointGains:
    """Return the gains of a recording."""
    n = fit.q.shape[1]
    reference = int(np.argmax(fit.size))
    free = np.flatnonzero((np.arange(n) != reference) & (fit.size > 0.0))
    equal, rng = fit.plain, np.random.default_rng(0)
    fits = [fit.run(equal.chain.axes, free=free)]
    for each in fit.plains:
        # The chain may be that of one joint, to which the gains of the others are relative.
        log = np.zeros(n)
        gains = fit.gains(each.chain)
        log[free] = np.log(gains[free] / gains[reference])
        fits.append(fit.run(each.chain.axes, log, free))
    best = min(fits, key=cost_of)
    # Few starts lead to the arm, whose residual is white. The first one has equal efforts of all
    # joints, the second one those of a reference with larger efforts.
    starts = [np.log(fit.size[free] / fit.size[reference]), np.full(len(free), -OPTIONS.spread),
              *rng.normal(0.0, OPTIONS.spread, (OPTIONS.starts, len(free)))]
    for seed, start in enumerate(starts):
        if fit.is_white(best) or fit.coloured(equal) < OPTIONS.min_coloured:
            break
        log = np.zeros(n)
        log[free] = start
        best = min(best, fit.run(fit.start(seed, log), log, free), key=cost_of)
    if fit.is_better(best, equal):
        # Equal gains may be at a wrong maximum, which other gains have left.
        equal = min(equal, *(fit.run(axes) for axes in (best.chain.axes, fit.start(starts=MANY))),
                    key=cost_of)
    std = np.zeros(n)
    std[free] = fit.std(best, free)
    return JointGains(fit.poses.names, reference, best.log, std, fit.rest(best),
                      fit.is_better(best, equal))
