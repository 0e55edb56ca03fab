"""
External torque: measured torque minus that of the model, with its standard deviation.

    tau_ext = sum_k w_k (tau - g(q) - f(q, qd))_k - d(q, qd, qdd)

g is gravity, f friction and the other effects, predicted or fitted, that depend on pose and speed,
d the dynamic torque of those that need an acceleration. Joint states have none, so that both parts
are means over a window of the last messages. qdd is the slope of a line fitted to the speeds. This
is a mean of the accelerations within the window, and w are its weights: a parabola. So inertia and
effort have the same delay of half a window. (A momentum observer uses the same numbers. Its filter
is exponential, so that a push appears whole after several time constants.)

The variance is the sum of the noise of the training, the scatter of the result between windows
(noise of the effort, and of the speeds times the inertia), the uncertainty of the model at this
pose, a share of the friction and of the dynamic torque, and the size of effects that depend on
earlier samples and are left out. The friction of a joint at rest takes any value between its
limits in the two directions, and no more: the centre of that range is subtracted, half of it is
the largest standard deviation that a value in it can have, and torque is significant if it is so
with every friction in the range. The limits are those of low speed, without viscous friction.

A push is not its own uncertainty. The scatter is that before the last `scatter_delay` s. A wrong
inertia changes the acceleration for a given torque of the drive, so that its error is a share of
the smaller of both, 0 if they have opposite signs: a push accelerates a joint without that torque.
"""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Needs
from gravity_comp_ros.effects.motion_direction import speed_law
from gravity_comp_ros.effects.predict import LiveEffects, static_std
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.evaluation.expected_residual import (
    FRICTION, RESIDUAL, residual_noise, size, static_limit)
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np


@dataclass(frozen=True)
class ExternalTorqueOptions:
    """
    Options of the external torque.

    `window` in s is that of the means. It holds at least `min_samples` messages, and begins again
    after a gap of `max_gap` s. `scatter_time` in s is the time constant of the mean in which the
    scatter between windows is estimated: many windows, and less than motion takes to change. The
    last `scatter_delay` s do not count: the time in which a push must be found.
    `significance` is the size in standard deviations, without the friction at rest, above which
    torque is significant.
    `share` is the relative error of friction (temperature, load) and of dynamic torque;
    `rest_speed` in rad/s is the speed below which the direction of friction is
    uncertain, if its law has none that is larger. Farther than `margin` in rad outside the trained
    range nothing is significant. A result is computed every `period` s at most, the uncertainty of
    the model every `std_period` s.

    :raises OptionError: if a number is not positive and finite.
    """

    window: float = 0.03
    min_samples: int = 4
    max_gap: float = 0.2
    scatter_time: float = 1.0
    scatter_delay: float = 0.05
    significance: float = 3.5
    share: float = RESIDUAL.drift
    rest_speed: float = 0.01
    margin: float = 0.1
    period: float = 0.005
    std_period: float = 0.1

    def __post_init__(self) -> None:
        check_positive(self, 'external torque')


@dataclass(frozen=True, eq=False)
class ExternalTorque:
    """
    External torque and its standard deviation in N·m, and whether it is significant.

    All are (N,), or (M, N) of a recording. The standard deviation is NaN where it is unknown, and
    nothing is significant there: outside the trained range, of a model without an uncertainty
    (`per_joint`), of a joint with an effect that cannot be computed, and in a recording where
    there is no result.
    """

    torque: FloatArray
    std: FloatArray
    significant: BoolArray


class ExternalTorqueObserver:
    """
    The external torque sample by sample, in order of time.

    `left_out` are the effects of the model that depend on earlier samples, as targets. They are
    not subtracted; their size is in the standard deviation.
    """

    def __init__(self, model: GravityModel,
                 options: ExternalTorqueOptions = ExternalTorqueOptions()) -> None:
        self._model, self.options = model, options
        library = all_effects()
        kinds = defaultdict[tuple[Needs, bool], list[AppliedEffect]](list)
        self._noise = residual_noise(model).copy()
        for effect in (*model.applied.effects, *model.fitted.effects):
            if _size_of(model, effect) is not None:
                own = library[effect.name]
                kinds[own.needs, own.family == FRICTION].append(effect)
            else:  # of another version: it cannot be computed
                self._noise[slice(None) if effect.joint is None
                            else model.joints.index(effect.joint)] = np.nan
        friction = [*kinds[Needs.SPEED, True], *kinds[Needs.HISTORY, True]]
        self._friction = LiveEffects(model, kinds.pop((Needs.SPEED, True)))
        self._others = LiveEffects(model, kinds.pop((Needs.SPEED, False), []))
        self._dynamics = LiveEffects(model, kinds.pop((Needs.ACCELERATION, False), []))
        left_out = [effect for rest in kinds.values() for effect in rest]
        self.left_out = tuple(effect.target for effect in left_out)
        self._noise = np.hypot(self._noise, size(model, left_out))
        self._slow = np.full(model.n_joints, options.rest_speed)
        for effect in friction:
            if effect.joint is not None:
                k = model.joints.index(effect.joint)
                self._slow[k] = max(self._slow[k], *speed_law(effect.setting, 0.0).values())
        self._limit = static_limit(model, friction, self._slow)
        # The running mean square of changes of the results, with its weight.
        self._squares, self._weight = np.zeros(model.n_joints), 0.0
        self._model_std = np.full(model.n_joints, np.nan)
        self.restart()

    def restart(self) -> None:
        """Forget earlier samples: the clock has started again."""
        self._rows = deque[tuple[float, FloatArray]]()
        # Results of the last `scatter_delay` s, and those of one window before it.
        self._recent = deque[tuple[float, FloatArray]]()
        self._results = deque[tuple[float, FloatArray]]()
        self._std_at = self._due = -np.inf

    def add(self, t: float, q: FloatArray, qd: FloatArray,
            tau: FloatArray) -> ExternalTorque | None:
        """
        Return the external torque (N,) after a sample, None while the window is not full.

        Within `period` s of the last result None is returned, too.

        :param t: time in s, later than before. :param q: pose (N,) in rad.
        :param qd: speed (N,) in rad/s. :param tau: measured torque (N,) in N·m.
        """
        options = self.options
        if self._rows and not 0.0 < t - self._rows[-1][0] <= options.max_gap:
            self.restart()
        rows = self._rows
        gravity = self._model.predict_one(q)
        friction = self._friction.torque(q, qd, gravity)
        rest = tau - gravity - friction - self._others.torque(q, qd, gravity)
        rows.append((t, np.stack([q, qd, gravity, friction, rest])))
        while len(rows) > options.min_samples and t - rows[1][0] >= options.window - 1e-9:
            rows.popleft()
        if (len(rows) < options.min_samples or t - rows[0][0] < 0.8 * options.window - 1e-9
                or t < self._due):
            return None
        self._due = t + options.period - 1e-9
        times = np.array([row[0] for row in rows])
        return self._of_window(t, times - times.mean(), np.array([row[1] for row in rows]))

    def _scatter(self, t: float, span: float, torque: FloatArray) -> FloatArray:
        """
        Return the variance (N,) in (N·m)^2 of the noise of the torque.

        Windows without a common sample have independent noise: half the mean square of their
        difference.

        :param span: duration of the window, s.
        """
        self._recent.append((t, torque))
        while self._recent and self._recent[0][0] <= t - self.options.scatter_delay + 1e-9:
            self._count(*self._recent.popleft(), span)
        return np.asarray(0.5 * self._squares / max(self._weight, 1e-9))

    def _count(self, t: float, torque: FloatArray, span: float) -> None:
        """Add the change from one window before to the mean square."""
        results = self._results
        results.append((t, torque))
        while len(results) > 1 and results[1][0] < t - span - 1e-9:
            results.popleft()
        if results[0][0] < t - span - 1e-9:
            share = min(1.0, (t - results[-2][0]) / self.options.scatter_time)
            self._weight += share * (1.0 - self._weight)
            self._squares += share * ((torque - results[0][1]) ** 2 - self._squares)

    def _of_window(self, t: float, times: FloatArray, values: FloatArray) -> ExternalTorque:
        """Return the external torque of a window: times (K,) in s, values (K, 5, N)."""
        options = self.options
        slope = times / (times @ times)
        qdd = slope @ values[:, 1]
        q, qd, gravity, friction, rest = np.tensordot(mean_weights(times, slope), values, 1)
        dynamics = self._dynamics.torque(q, qd, gravity, qdd)
        low, high = self._range_of_friction(qd, friction)
        torque, half = rest + friction - 0.5 * (low + high) - dynamics, 0.5 * (high - low)
        # A step of the drive's torque within the window counts in full.
        drive = np.maximum((values[:, 4] * np.sign(dynamics)).max(axis=0), 0.0)
        variance = (self._noise ** 2 + self._scatter(t, float(np.ptp(times)), torque)
                    + self._std_of_model(t, q) ** 2
                    + (options.share * np.maximum(high, -low)) ** 2
                    + (options.share * np.minimum(drive, np.abs(dynamics))) ** 2)
        std = np.sqrt(variance)
        if (self._model.coverage.distance(q) > options.margin).any():
            std = np.full_like(std, np.nan)
        return ExternalTorque(torque, np.hypot(std, half),
                              np.abs(torque) - half > options.significance * std)

    def _range_of_friction(self, qd: FloatArray,
                           friction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and the largest friction (N,) in N·m that these speeds allow."""
        size = np.abs(friction)
        limit = np.maximum(self._limit, size)
        change = np.exp(-(qd / self._slow) ** 2) * (self._limit + size)
        return np.maximum(friction - change, -limit), np.minimum(friction + change, limit)

    def _std_of_model(self, t: float, q: FloatArray) -> FloatArray:
        if not 0.0 <= t - self._std_at < self.options.std_period:
            self._std_at = t
            try:
                self._model_std = static_std(self._model, q[None], (
                    *self._model.applied.effects, *self._model.fitted.effects))[0]
            except (DataError, ModelMismatchError, np.linalg.LinAlgError):
                self._model_std = np.full(len(q), np.nan)
        return self._model_std


def _size_of(model: GravityModel, effect: AppliedEffect) -> FloatArray | None:
    """Return the size (N,) in N·m of an effect, None if it cannot be computed."""
    try:
        return size(model, [effect])
    except (ModelMismatchError, AttributeError, LookupError, ValueError):
        return None


def mean_weights(times: FloatArray, slope: FloatArray) -> FloatArray:
    """
    Return the weights (K,) of torques at times (K,) whose mean has the slope of the speeds.

    The slope sum_k slope_k v_k is sum_j W_j (v_{j+1} - v_j), W the negative sum of slope_1 to
    slope_j: a mean of the accelerations of the intervals with the weights W_j (t_{j+1} - t_j).
    Each is that of the mean of its two ends.
    """
    intervals = -0.5 * np.cumsum(slope)[:-1] * np.diff(times)
    return np.asarray(np.append(intervals, 0.0) + np.append(0.0, intervals))


def external_torque(model: GravityModel, samples: JointSamples,
                    options: ExternalTorqueOptions = ExternalTorqueOptions()) -> ExternalTorque:
    """
    Return the external torque (M, N) of a recording, as the node publishes it.

    :raises ModelMismatchError: if a joint of the model is not among the samples.
    """
    samples = samples.joints(model.joints)
    torque, std = np.zeros_like(samples.q), np.full_like(samples.q, np.nan)
    significant = np.zeros(samples.q.shape, dtype=bool)
    for run in run_slices(samples):
        observer = ExternalTorqueObserver(model, options)
        for k in range(run.start, run.stop):
            now = observer.add(float(samples.t[k]), samples.q[k], samples.qd[k], samples.tau[k])
            if now is not None:
                torque[k], std[k], significant[k] = now.torque, now.std, now.significant
    return ExternalTorque(torque, std, significant)
