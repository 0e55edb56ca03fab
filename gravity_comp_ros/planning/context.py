"""
Information matrices of effects and their alternatives along recorded and planned motion.

Rows are weighted by the measured noise variance and correlation time. Nuisance terms are fitted
jointly with the effect: the gravity parameters, and Coulomb and viscous friction, offset and
inertia of each joint. A motion is reduced to its information matrix; those of several motions add.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from gravity_comp_ros.data.runs import have_common_clock, recorded_time, session_time
from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.diagnosis.options import SelectionOptions
from gravity_comp_ros.effects.effect import Effect, Expectation, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.least_squares import svd
from gravity_comp_ros.models.noise import correlation_time
from gravity_comp_ros.models.sparse.projected import orthonormal_basis
from gravity_comp_ros.planning.gravity_parameters import free_columns, free_prior_std
from gravity_comp_ros.planning.segments import sampled, Segment
import numpy as np

# Effects that are nuisance terms of a joint, one column each; inertia has one per joint.
_NUISANCE = ('coulomb_friction', 'viscous_friction', 'torque_offset')
_NUISANCE_PRIOR = 1e-6
# Ratio of the torque shares outside the gravity terms of a diagnosis and of an energy.
_GRAVITY_FACTOR = 0.5
# Assumed pause between the last recording and the planned motion, s.
_PAUSE = 60.0


@dataclass(frozen=True)
class Hypothesis:
    """An effect on a joint (None: the whole arm) with values of its nonlinear parameters."""

    effect: Effect
    joint: int | None
    setting: Setting

    @property
    def key(self) -> tuple[str, int | None]:
        return self.effect.name, self.joint


@dataclass(frozen=True)
class DesignProblem:
    """
    A target effect and its alternatives.

    `size` (K,) are the assumed coefficients of the target, estimates if `known_size`. `joints` are
    those whose torque enters the information matrix.
    """

    target: Hypothesis
    alternatives: tuple[Hypothesis, ...]
    size: FloatArray
    joints: tuple[int, ...]
    known_size: bool

    def untested_alternatives(self, both: Motion, named: Sequence[str]) -> set[int]:
        """
        Return the numbers of the alternatives that a diagnosis of a motion does not test.

        :param named: alternatives that always count.
        """
        names = {name.partition(':')[0] for name in named}
        return {k for k, other in enumerate(self.alternatives) if other.effect.name not in names
                and other.effect.untestable(both, other.joint or 0) is not None}

    def remaining_ambiguity(self, both: Motion, named: Sequence[str]) -> str:
        """
        Return why a diagnosis of a motion leaves the target ambiguous, '' if it does not.

        :param named: alternatives named by an earlier diagnosis, each NAME or NAME:JOINT.
        """
        for other in self.alternatives:
            if other.joint == self.target.joint and other.effect.name in named:
                reason = other.effect.untestable(both, other.joint or 0)
                if reason is not None:
                    return f'its alternative {other.effect.name} remains untestable: {reason}'
        return ''


@dataclass(frozen=True, eq=False)
class DesignContext:
    """
    Recorded motion, gravity model and noise.

    `information_rate` (N,) in 1/(N·m)² is the information of one second of motion: one over the
    variance of the residual, per correlation time. `independent_rate` (N,) in 1/s is one over the
    correlation time. `step` in s is the time between samples of the recordings, of which
    `recorded` is a subset; `rate` in Hz is that of planned motion.
    """

    recorded: Motion
    model: GravityModel
    information_rate: FloatArray
    independent_rate: FloatArray
    step: float
    rate: float
    memo: dict[str, FloatArray] = field(default_factory=dict, repr=False)

    @property
    def n_joints(self) -> int:
        return self.recorded.samples.n_joints

    def planned(self, segments: Sequence[Segment], gradient: bool = False) -> Motion:
        """
        Return a planned motion with predicted torque, `n_prefix` recorded rows in front.

        :param gradient: whether the effects use the gradient of gravity by the angles.
        """
        t, (q, qd, qdd) = sampled(segments, self.rate)
        names, before = self.recorded.samples.names, self._session
        if before is None:
            samples = JointSamples.single_run(names, t, q, qd, np.zeros_like(q))
        else:
            samples = concatenate([before, JointSamples.single_run(
                names, t, q, qd, np.zeros_like(q), start=self._end + _PAUSE)])
            qdd = np.vstack([np.zeros(self.n_joints), qdd])
        gravity = self.model.predict(samples.q)
        slopes = None if gradient else np.zeros((*gravity.shape, self.n_joints))
        return Motion(replace(samples, tau=gravity), qdd, gravity, slopes,
                      self.recorded.sign_width, self.model, self.recorded.hold,
                      ramp=self.recorded.ramp)

    def joined(self, segments: Sequence[Segment]) -> Motion:
        """
        Return recordings and planned motion together, as input of a diagnosis.

        The gradient of gravity is zero in the planned rows.
        """
        old, model = self.recorded, self.model
        t, (q, qd, qdd) = sampled(segments, 1.0 / self.seconds_per_row)
        start = self._end + _PAUSE if old.samples.starts else None
        new = JointSamples.single_run(old.samples.names, t, q, qd, model.predict(q), start=start)
        gravity = np.vstack([old.gravity, new.tau])
        slopes = np.concatenate([old.gradient, np.zeros((len(t), *old.gradient.shape[1:]))])
        return Motion(concatenate([old.samples, new]), np.vstack([old.qdd, qdd]), gravity, slopes,
                      old.sign_width, model, old.hold, ramp=old.ramp)

    @cached_property
    def _session(self) -> JointSamples | None:
        """
        Return the first sample of the session that a new recording continues.

        None without a common clock: a new recording is then a session of its own.
        """
        samples = self.recorded.samples
        if not samples.starts or not have_common_clock(samples):
            return None
        first = int(np.flatnonzero(session_time(samples) == 0.0)[-1])
        return samples.select([first]).run(int(samples.runs[first]))

    @property
    def _end(self) -> float:
        """Return the time of the last sample on the clock, s."""
        samples = self.recorded.samples
        return float((np.array(samples.starts)[samples.runs] + samples.t).max())

    @property
    def gravity_factor(self) -> float:
        """
        Return the ratio of the torque shares outside the gravity of a diagnosis and of the model.

        A diagnosis of a serial arm has the terms of its chain; otherwise it has more.
        """
        return 1.0 if self.model.chain is not None else _GRAVITY_FACTOR

    @property
    def n_gravity(self) -> int:
        """Return the number of gravity parameters among the nuisance terms."""
        return len(self._gravity_std())

    @property
    def n_prefix(self) -> int:
        """Return the number of rows in front of a planned motion that do not belong to it."""
        return int(self._session is not None)

    @property
    def seconds_per_row(self) -> float:
        """Return the recorded time per row of `recorded`, s."""
        samples = self.recorded.samples
        return max(recorded_time(samples), 1e-9) / samples.n_samples

    def nuisance_columns(self, motion: Motion) -> FloatArray:
        """Return the nuisance columns of all joints, (M, N, K)."""
        return np.stack([_nuisance('', motion, n) for n in range(self.n_joints)], axis=1)

    def information(self, problem: DesignProblem, motion: Motion, seconds: float,
                    n_prefix: int = 0) -> FloatArray:
        """
        Return the information matrix (P, P) of nuisance terms, target and alternatives.

        The order is: gravity, nuisance terms of each joint, target, each alternative.

        :param seconds: the time that a row represents.
        :param n_prefix: the number of rows in front that do not belong to the motion.
        """
        total: FloatArray | None = None
        gravity = self._gravity(motion)
        effects = np.concatenate(
            [one.effect.columns_of_arm(motion, one.joint or 0, one.setting)
             for one in (problem.target, *problem.alternatives)], axis=2)
        for place, n in enumerate(problem.joints):
            own = _nuisance(problem.target.effect.name, motion, n)
            blocks = np.zeros((len(own), len(problem.joints), own.shape[1]))
            blocks[:, place] = own
            rows = np.column_stack([gravity[:, n], blocks.reshape(len(own), -1), effects[:, n]])
            rows = rows[n_prefix:]
            part = (rows.T @ rows) * (seconds * self.information_rate[n])
            total = part if total is None else total + part
        if total is None:
            raise OptionError('plan: a target without a joint')
        k = gravity.shape[2]
        for n in set(range(self.n_joints)) - set(problem.joints):
            total[:k, :k] += (seconds * self.information_rate[n]) * self._on_gravity(
                motion, n, n_prefix)
        return total

    def _on_gravity(self, motion: Motion, joint: int, n_prefix: int) -> FloatArray:
        """
        Return the information of a joint's torque on gravity, cached with the motion.

        The joint's nuisance terms are projected out of each motion separately. This is a lower
        bound: a diagnosis fits them once for all motions.
        """
        key = f'shared by {joint}'
        if key not in motion.memo:
            rows = self._gravity(motion)[n_prefix:, joint]
            basis = orthonormal_basis(_nuisance('', motion, joint)[n_prefix:])
            rest: FloatArray = rows - basis @ (basis.T @ rows)
            motion.memo[key] = rest.T @ rest
        return motion.memo[key]

    def with_measured_noise(self, problems: Sequence[DesignProblem]) -> DesignContext:
        """
        Return the same with the noise of the residual after a fit of all known terms.

        These are gravity, rigid-body terms and all targets and alternatives: the torque of an
        effect is not noise, nor is a gravity error that a diagnosis refits.
        """
        motion, variances, times = self.recorded, *np.empty((2, self.n_joints))
        samples = motion.samples
        residual, qd = samples.tau - motion.gravity, samples.qd
        one, other = np.triu_indices(self.n_joints)
        hypotheses = {(*a.key, *a.setting.items()): a
                      for p in problems for a in (p.target, *p.alternatives)}.values()
        effects = [a.effect.columns_of_arm(motion, a.joint or 0, a.setting) for a in hypotheses]
        for n in range(self.n_joints):
            columns = np.column_stack([
                motion.direction(n), qd[:, n], np.ones(len(qd)), motion.qdd,
                qd[:, one] * qd[:, other], self._gravity(motion)[:, n],
                *(columns[:, n] for columns in effects)])
            variances[n], times[n] = _noise(residual[:, n], columns, samples, self.step)
        return replace(self, information_rate=1.0 / (variances * times),
                       independent_rate=1.0 / times, memo={})

    def required_separation(self, problem: DesignProblem, planned: float) -> float:
        """
        Return the separation with which a rare effect has its minimum share of the error.

        A diagnosis of n independent samples requires a share of lambda / (lambda + n), with lambda
        the squared separation. 0 for common effects, which need no such share. Torque on several
        joints counts as if it were on one.

        :param planned: duration of the planned motion in s, 0 for the recordings alone.
        """
        if problem.target.effect.expectation != Expectation.RARE:
            return 0.0
        seconds = recorded_time(self.recorded.samples) + planned
        n = float(self.independent_rate[list(problem.joints)].mean()) * seconds
        share = SelectionOptions().min_rare_share
        return float(np.sqrt(n * share / (1.0 - share)))

    def prior(self, problem: DesignProblem) -> FloatArray:
        """Return the prior information (Z,) on gravity and nuisance terms."""
        n_nuisance = self.n_joints + sum(
            name != problem.target.effect.name for name in _NUISANCE)
        return np.concatenate([1.0 / self._gravity_std() ** 2,
                               np.full(len(problem.joints) * n_nuisance, _NUISANCE_PRIOR)])

    def _gravity(self, motion: Motion) -> FloatArray:
        """Return the gravity columns (M, N, K), cached with the motion."""
        if 'gravity parameters' not in motion.memo:
            motion.memo['gravity parameters'] = free_columns(self.model, motion.samples.q)
        return motion.memo['gravity parameters']

    def _gravity_std(self) -> FloatArray:
        if 'std' not in self.memo:
            self.memo['std'] = free_prior_std(self.model)
        return self.memo['std']


def _noise(residual: FloatArray, columns: FloatArray, samples: JointSamples,
           step: float) -> tuple[float, float]:
    """
    Return the variance of the noise and its correlation time in s.

    :param step: the time between recorded samples, s.
    """
    scale = np.sqrt((columns ** 2).mean(axis=0))
    columns = columns[:, scale > 1e-9] / scale[scale > 1e-9]
    basis, size, _ = svd(columns)
    basis = basis[:, size > 1e-6 * size[0]]
    rest = residual - basis @ (basis.T @ residual)
    dof = max(len(rest) - basis.shape[1], 1)
    between = np.diff(samples.t)[np.diff(samples.runs) == 0]
    apart = float(np.median(between)) if len(between) else step
    time = correlation_time(rest, samples.runs) * apart
    # A thinned recording does not show correlation between the samples in between.
    time = step if time <= 1.5 * apart else time
    return max(float(rest @ rest) / dof, 1e-12), max(time, 1e-9)


def _nuisance(target: str, motion: Motion, joint: int) -> FloatArray:
    """Return a joint's nuisance columns (M, K) without that of the target itself."""
    qd = motion.samples.qd[:, joint]
    columns = (motion.direction(joint), qd, np.ones(len(qd)))
    kept = [column for name, column in zip(_NUISANCE, columns) if name != target]
    return np.column_stack([*kept, motion.qdd])


def n_columns(one: Hypothesis, motion: Motion) -> int:
    """Return the number of regressor columns of an effect."""
    return int(one.effect.columns(motion, one.joint or 0, one.setting).shape[-1])
