"""
Regressors of an effect and of what could be taken for it, along recorded and planned motion.

Rows are whitened: each counts by the noise and the autocorrelation that were measured. Nuisance
terms stand beside the effect: gravity's own parameters, Coulomb and viscous friction, offset and
inertia of each joint. Their information matrix is all that is kept of a motion, and those of
several motions add.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from gravity_comp_ros.data.runs import have_common_clock, recorded_time, session_time
from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Effect, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.least_squares import svd
from gravity_comp_ros.models.noise import correlation_time
from gravity_comp_ros.models.sparse.projected import orthonormal_basis
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.planning.segments import sampled, Segment
import numpy as np

# Columns of a joint's own nuisance terms, by the effect that each of them is.
_OWN = ('coulomb_friction', 'viscous_friction', 'torque_offset')
# Of a torque that the model's gravity cannot imitate, that of a diagnosis leaves about this share.
_IMITATION = 0.5
# What is known of gravity before any data: axes to 0.3 rad, moments to their own size.
_AXIS_SPREAD = 0.3
# A new recording is taken to begin so long after the last one, s.
_PAUSE = 60.0


@dataclass(frozen=True)
class Alternative:
    """An effect on a joint (None: the whole arm) with one setting."""

    effect: Effect
    joint: int | None
    setting: Setting

    @property
    def key(self) -> tuple[str, int | None]:
        return self.effect.name, self.joint


@dataclass(frozen=True)
class Question:
    """
    An effect to settle, and what explains the same.

    `size` (K,) are the coefficients that the effect is taken to have. `joints` are those on
    whose torque it is judged.
    """

    target: Alternative
    alternatives: tuple[Alternative, ...]
    size: FloatArray
    joints: tuple[int, ...]
    known_size: bool

    def never_tested(self, both: Motion, named: Sequence[str]) -> set[int]:
        """
        Return the alternatives that a diagnosis of a motion does not consider.

        :param named: alternatives that count whatever the motion.
        """
        names = {name.partition(':')[0] for name in named}
        return {k for k, other in enumerate(self.alternatives) if other.effect.name not in names
                and other.effect.untestable(both, other.joint or 0) is not None}

    def tie_stays(self, both: Motion, named: Sequence[str]) -> str:
        """
        Return why a diagnosis of a motion will still call this ambiguous, '' if it will not.

        :param named: alternatives that explained the recordings as well, each NAME or NAME:JOINT.
        """
        for other in self.alternatives:
            if other.joint == self.target.joint and other.effect.name in named:
                reason = other.effect.untestable(both, other.joint or 0)
                if reason is not None:
                    return f'{other.effect.name}, which may explain it, stays untestable: {reason}'
        return ''


@dataclass(frozen=True, eq=False)
class NoiseRate:
    """
    What a second of motion is worth: `per_second` (N,) in 1/(N·m)².

    One over the variance of the residual, for every correlation time of it.
    """

    per_second: FloatArray


@dataclass(frozen=True, eq=False)
class Situation:
    """
    The recorded motion as effects see it, the model, and the noise.

    `step` in s is the time between the samples of the recordings, of which `recorded` has some;
    `rate` in Hz is that at which planned motion is looked at.
    """

    recorded: Motion
    model: GravityModel
    noise: NoiseRate
    step: float
    rate: float
    memo: dict[str, FloatArray] = field(default_factory=dict, repr=False)

    @property
    def n_joints(self) -> int:
        return self.recorded.samples.n_joints

    def planned(self, segments: list[Segment] | tuple[Segment, ...],
                gradient: bool = False) -> Motion:
        """Return a planned motion as effects will see it, its torque as predicted."""
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
                      self.recorded.sign_width, self.model, self.recorded.hold)

    def joined(self, segments: Sequence[Segment]) -> Motion:
        """
        Return recordings and a planned motion as a diagnosis of both will see them.

        How gravity changes with the angles is left out of the planned part.
        """
        old, model = self.recorded, self.model
        t, (q, qd, qdd) = sampled(segments, 1.0 / self.seconds_a_row)
        start = self._end + _PAUSE if old.samples.starts else None
        new = JointSamples.single_run(old.samples.names, t, q, qd, model.predict(q), start=start)
        gravity = np.vstack([old.gravity, new.tau])
        slopes = np.concatenate([old.gradient, np.zeros((len(t), *old.gradient.shape[1:]))])
        return Motion(concatenate([old.samples, new]), np.vstack([old.qdd, qdd]), gravity, slopes,
                      old.sign_width, model, old.hold)

    @cached_property
    def _session(self) -> JointSamples | None:
        """
        Return the first sample of the session that a new recording goes on with.

        None if the recordings are on no clock: then a new one is a session of its own.
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
    def imitation(self) -> float:
        """
        Return the share that the gravity of a diagnosis leaves of what the model's leaves.

        On known axes both have the same terms, elsewhere that of a diagnosis has more.
        """
        return 1.0 if self.model.geometry is not None else _IMITATION

    @property
    def n_gravity(self) -> int:
        """Return how many parameters of gravity are nuisance terms."""
        return len(self._gravity_spread())

    @property
    def skip(self) -> int:
        """Return how many rows in front of a planned motion are none of it."""
        return int(self._session is not None)

    @property
    def seconds_a_row(self) -> float:
        """Return how long a row of recorded samples stands for, in s."""
        samples = self.recorded.samples
        return max(recorded_time(samples), 1e-9) / samples.n_samples

    def planned_information(self, question: Question, motion: Motion) -> FloatArray:
        """Return the information matrix of a planned motion."""
        return self.information(question, motion, 1.0 / self.rate, self.skip)

    def own_columns(self, motion: Motion) -> FloatArray:
        """Return the nuisance columns of all joints, (M, N, K)."""
        return np.stack([_own('', motion, n) for n in range(self.n_joints)], axis=1)

    def information(self, question: Question, motion: Motion, seconds: float,
                    skip: int = 0) -> FloatArray:
        """
        Return the information matrix (P, P) of nuisance terms and the question's effects.

        Gravity and each joint's nuisance terms come first, then the target's columns, then those
        of each alternative.

        :param seconds: the time that a row stands for.
        :param skip: so many rows in front are none of the motion.
        """
        total: FloatArray | None = None
        gravity = self._gravity(motion)
        effects = [one.effect.columns_of_arm(motion, one.joint or 0, one.setting)
                   for one in (question.target, *question.alternatives)]
        every = np.concatenate(effects, axis=2)
        for place, n in enumerate(question.joints):
            own = _own(question.target.effect.name, motion, n)
            blocks = np.zeros((len(own), len(question.joints), own.shape[1]))
            blocks[:, place] = own
            rows = np.column_stack([gravity[:, n], blocks.reshape(len(own), -1), every[:, n]])
            rows = rows[skip:]
            part = (rows.T @ rows) * (seconds * self.noise.per_second[n])
            total = part if total is None else total + part
        if total is None:
            raise OptionError('plan: a question about no joint')
        k = gravity.shape[2]
        for n in set(range(self.n_joints)) - set(question.joints):
            total[:k, :k] += (seconds * self.noise.per_second[n]) * self._shared(motion, n, skip)
        return total

    def _shared(self, motion: Motion, joint: int, skip: int) -> FloatArray:
        """
        Return the information of a joint's rows on gravity, kept with the motion.

        Its own nuisance terms are projected out of each motion by itself: the diagnosis, which
        has them once for all, finds no less.
        """
        key = f'shared by {joint}'
        if key not in motion.memo:
            rows, own = self._gravity(motion)[skip:, joint], _own('', motion, joint)[skip:]
            basis = orthonormal_basis(own)
            rest = rows - basis @ (basis.T @ rows)
            motion.memo[key] = rest.T @ rest
        return motion.memo[key]

    def measured(self, questions: Sequence[Question]) -> Situation:
        """
        Return the same with the noise that is left beside gravity, motion and all questions.

        What an effect itself does to the torque is not noise, nor is what a gravity model lacks
        that a diagnosis refits.
        """
        motion, rates = self.recorded, np.empty(self.n_joints)
        samples = motion.samples
        residual, qd = samples.tau - motion.gravity, samples.qd
        one, other = np.triu_indices(self.n_joints)
        every = {(*a.key, *a.setting.items()): a
                 for q in questions for a in (q.target, *q.alternatives)}.values()
        effects = [a.effect.columns_of_arm(motion, a.joint or 0, a.setting) for a in every]
        for n in range(self.n_joints):
            known = np.column_stack([
                motion.direction(n), qd[:, n], np.ones(len(qd)), motion.qdd,
                qd[:, one] * qd[:, other], self._gravity(motion)[:, n],
                *(columns[:, n] for columns in effects)])
            rates[n] = _worth(residual[:, n], known, samples, self.step)
        return replace(self, noise=NoiseRate(rates), memo={})

    def prior(self, question: Question) -> FloatArray:
        """Return what is known of gravity and nuisance terms before any data, (P,)."""
        gravity = 1.0 / self._gravity_spread() ** 2
        own = np.full(len(question.joints) * self._n_own(question), 1e-6)
        return np.concatenate([gravity, own])

    def _n_own(self, question: Question) -> int:
        return sum(name != question.target.effect.name for name in _OWN) + self.n_joints

    def _gravity(self, motion: Motion) -> FloatArray:
        """Return how gravity changes with its parameters, (M, N, K), kept with the motion."""
        if 'gravity parameters' not in motion.memo:
            motion.memo['gravity parameters'] = _gravity_columns(self.model, motion.samples.q)
        return motion.memo['gravity parameters']

    def _gravity_spread(self) -> FloatArray:
        if 'spread' not in self.memo:
            self.memo['spread'] = _gravity_spread(self.model)
        return self.memo['spread']


def _worth(residual: FloatArray, known: FloatArray, samples: JointSamples, step: float) -> float:
    """Return what a second is worth, `step` s being the time between samples recorded."""
    scale = np.sqrt((known ** 2).mean(axis=0))
    known = known[:, scale > 1e-9] / scale[scale > 1e-9]
    basis, size, _ = svd(known)
    basis = basis[:, size > 1e-6 * size[0]]
    rest = residual - basis @ (basis.T @ residual)
    left = max(len(rest) - basis.shape[1], 1)
    between = np.diff(samples.t)[np.diff(samples.runs) == 0]
    apart = float(np.median(between)) if len(between) else step
    time = correlation_time(rest, samples.runs) * apart
    # A thinned recording says nothing of correlation between the samples left out.
    time = step if time <= 1.5 * apart else time
    return 1.0 / (max(float(rest @ rest) / left, 1e-12) * max(time, 1e-9))


def _gravity_columns(model: GravityModel, q: FloatArray) -> FloatArray:
    if model.chain is not None:
        return model.chain.jacobian(q).transpose(2, 1, 0)[:, :, _first_free(model):]
    if model.energy is None:
        raise OptionError('plan needs a model with an energy: fit a chain or a potential')
    design = EnergyDesign(q, np.ones_like(q))
    columns = np.asarray(design.columns(model.energy.indices))
    return columns.reshape(model.n_joints, len(q), -1).transpose(1, 0, 2)


def _first_free(model: GravityModel) -> int:
    """
    Return the number of the first parameter of a chain that data have to tell.

    The first two turn the base: a tilted base is an effect of its own. Of known axes only the
    moments are free.
    """
    return 2 if model.geometry is None else 2 * model.n_joints


def _gravity_spread(model: GravityModel) -> FloatArray:
    if model.chain is not None:
        n = model.n_joints
        largest = max(float(np.abs(model.chain.moments).max()), 1e-3)
        every = np.concatenate([np.full(2 * n, _AXIS_SPREAD), np.full(2 * n, largest)])
        return every[_first_free(model):]
    if model.energy is None:
        raise OptionError('plan needs a model with an energy: fit a chain or a potential')
    largest = max(float(np.abs(model.energy.weights).max(initial=0.0)), 1e-3)
    return np.full(len(model.energy.indices), largest)


def _own(target: str, motion: Motion, joint: int) -> FloatArray:
    """Return a joint's nuisance columns (M, K) without the target's own."""
    qd = motion.samples.qd[:, joint]
    every = {'coulomb_friction': motion.direction(joint), 'viscous_friction': qd,
             'torque_offset': np.ones(len(qd))}
    kept = [column for name, column in every.items() if name != target]
    return np.column_stack([*kept, motion.qdd])


def width(one: Alternative, motion: Motion) -> int:
    """Return how many columns an effect has."""
    return int(one.effect.columns(motion, one.joint or 0, one.setting).shape[-1])
