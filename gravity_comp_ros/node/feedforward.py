"""Feed-forward torque: ramped, limited, and with a watchdog for input that stops."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
import math

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.data.short_vectors import all_finite
from gravity_comp_ros.node.compensation_blend import Compensation, CompensationBlend
from gravity_comp_ros.node.feedforward_options import FeedForwardOptions, per_joint
from gravity_comp_ros.node.torque_source import TorqueSource
import numpy as np

# States, as they appear in diagnostics.
NO_MODEL = 'no model'
DISABLED = 'disabled'
WAITING = 'waiting for input'
RAMPING = 'ramping'
ACTIVE = 'active'
HOLDING = 'stale, holding'
FADING = 'stale, fading'
FADED = 'stale, faded to zero'

# Maximum time step of one message in units of the message period. The time of a stall is spread
# over the messages that follow it.
MAX_PERIODS = 2.0
# Number of messages for the median period, and minimum period, s.
PERIOD_MESSAGES, MIN_PERIOD = 20, 1e-3
# Maximum change by a swap of models within `ramp_time`, N·m; a larger change takes longer. With
# the default of 1 s this is 0.048 N·m per message at 250 Hz.
SWAP_CHANGE = 12.0
# Maximum time step of one call of the watchdog, s.
WATCH_PERIOD = 0.02


class FeedForward:
    """
    Torque for each pose; the caller passes the time `now` in s.

    A gain between 0 and 1 multiplies the torque of the model. It rises over `ramp_time` when the
    first model is in use, input returns or torque is enabled. It falls when torque is disabled or
    input is stale for longer than `hold_time`. A swap of models blends their torques over
    `ramp_time`, and over a longer time if the change exceeds `SWAP_CHANGE`. The limits apply to
    the sum, so the published torque never exceeds them.

    :param n_joints: the number N of joints.
    """

    def __init__(self, n_joints: int, options: FeedForwardOptions) -> None:
        self._n = n_joints
        self._enabled = True
        self._gain = 0.0
        self._blend = 1.0
        self._source: TorqueSource | None = None
        self._old: TorqueSource | None = None
        # Torque minus that of `_old` at the start of the blend, N·m.
        self._offset = np.zeros(n_joints)
        self._q: FloatArray | None = None
        self._share, self._share_goal = np.ones(n_joints), np.ones(n_joints)
        self._base = np.zeros(n_joints)
        self._compensation = CompensationBlend(n_joints)
        self._effects = np.zeros(n_joints)
        self._last = np.zeros(n_joints)
        self._now: float | None = None
        # Time of a stall that is not yet spread over messages, s.
        self._owed = 0.0
        self._intervals: deque[float] = deque(maxlen=PERIOD_MESSAGES)
        self._fresh: float | None = None
        self.set_options(options)

    def set_options(self, options: FeedForwardOptions) -> None:
        """Use other limits and times from now on."""
        self.options = options
        self._limit = per_joint(options.max_torque, self._n)
        self._rate = per_joint(options.max_torque_rate, self._n)

    def use(self, source: TorqueSource | None, share: FloatArray | None = None) -> None:
        """
        Blend to another model; None stops publishing.

        :param share: share of the change from `source.before` (N,), 0 to 1; None for 1.
        """
        if source is None or self._source is None:
            self._gain = 0.0 if source is None else self._gain
            self._old, self._blend = None, 1.0
        else:
            # A swap during a swap starts from the present torque, kept as an offset from the old
            # model so that the torque follows the pose during the blend.
            self._offset = np.zeros(self._n)
            if self._blend < 1.0 and self._q is not None:
                self._offset = self._base - self._torque(self._source, self._q)
            old = self._source
            self._old = replace(old, predict=old.with_share(self._share.copy()), before=None)
            self._blend = 0.0
        self._source = source
        self._share = np.ones(self._n) if share is None else share
        self._share_goal = self._share

    def compensate(self, compensation: Compensation | None) -> None:
        """
        Blend to another torque of effects, which is added to gravity; None for no torque.

        It is added within the margin of the trained range. Beyond it, without a speed and with
        stale input it ramps to zero.
        """
        self._compensation.use(compensation)

    def set_share(self, share: FloatArray) -> None:
        """Blend to another share of the change, as slowly as to another model."""
        self._share_goal = share

    def enable(self, enabled: bool) -> None:
        """Allow or forbid torque; it ramps either way."""
        self._enabled = enabled

    def restart(self) -> None:
        """Forget torque and input; with the next message torque ramps up from zero."""
        self._gain, self._blend, self._old = 0.0, 1.0, None
        self._share = self._share_goal
        self._compensation.restart()
        self._effects, self._last = np.zeros(self._n), np.zeros(self._n)
        self._fresh = self._now = None
        self._owed = 0.0
        self._intervals.clear()

    @property
    def enabled(self) -> bool:
        return self._enabled

    @property
    def margin(self) -> float:
        """Distance outside the trained range up to which the model is used unchanged, rad."""
        return self._margin_of(self._source)

    def update(self, now: float, q: FloatArray,
               qd: FloatArray | None = None) -> FloatArray | None:
        """
        Return the torque (N,) in N·m to publish at pose `q` (N,), None for nothing.

        A torque of the model that is not finite counts as missing input for the watchdog.

        :param qd: speed (N,) in rad/s for the torque of effects, None if unknown.
        """
        dt = self._since_last_message(now)
        if self._source is None:
            self._fresh = now
            return None
        base = self._advanced(self._source, q, dt)
        if not all_finite(base):
            return None
        self._fresh, self._base, self._q = now, base, q
        step = self._ramp_step(dt)
        self._effects = (self._compensation.torque(q, qd, step) if self._is_near(self._source, q)
                         else self._compensation.fade(step))
        silent = not self._enabled and self._is_at_rest()
        self._approach(1.0 if self._enabled else 0.0, self.options.ramp_time, dt)
        return None if silent else self._limited(dt)

    def watch(self, now: float) -> FloatArray | None:
        """Return the torque to publish without input, None if none is due."""
        if self._fresh is None or self._source is None:
            return None
        # After the clock was set back, old input must not count as recent.
        self._fresh = min(self._fresh, now)
        age = now - self._fresh
        if age <= self.options.stale_after:
            return None
        self._owed = 0.0
        dt = min(self._elapsed(now), max(WATCH_PERIOD, MAX_PERIODS * self._period()))
        if self._is_at_rest():
            return None
        # Friction depends on the direction of motion, which is unknown without input.
        self._effects = self._compensation.fade(self._ramp_step(dt))
        if not self._enabled:
            self._approach(0.0, self.options.ramp_time, dt)
        elif self.options.stale_action == 'fade' and (
                age > self.options.stale_after + self.options.hold_time):
            self._approach(0.0, self.options.fade_time, dt)
        return self._limited(dt)

    def state(self, now: float) -> str:
        """Return the state, one of the constants above."""
        if self._source is None:
            return NO_MODEL
        if self._fresh is None:
            return WAITING
        if not self._enabled:
            return DISABLED if self._gain == 0.0 else RAMPING
        age = now - self._fresh
        if age > self.options.stale_after:
            if self._gain == 0.0:
                return FADED
            fades = self.options.stale_action == 'fade'
            held = age <= self.options.stale_after + self.options.hold_time
            return FADING if fades and not held else HOLDING
        return ACTIVE if self._gain == 1.0 and self._blend == 1.0 else RAMPING

    def _elapsed(self, now: float) -> float:
        """Return the time since the last call, at most `stale_after`: the clock may jump."""
        dt = 0.0 if self._now is None else now - self._now
        self._now = now
        return min(max(dt, 0.0), self.options.stale_after)

    def _since_last_message(self, now: float) -> float:
        """Return the time step of a message; the time of a stall is spread over several."""
        dt = self._elapsed(now)
        counted = dt
        if self._intervals:
            counted = min(dt + self._owed, MAX_PERIODS * self._period())
        self._owed = min(max(0.0, self._owed + dt - counted), self.options.stale_after)
        if dt > 0.0:
            self._intervals.append(dt)
        return counted

    def _period(self) -> float:
        """Return the median time between messages, s."""
        intervals = sorted(self._intervals)
        return max(MIN_PERIOD, intervals[len(intervals) // 2]) if intervals else MIN_PERIOD

    def _approach(self, goal: float, duration: float, dt: float) -> None:
        step = 1.0 if duration <= 0.0 else dt / duration
        self._gain += min(max(goal - self._gain, -step), step)

    def _ramp_step(self, dt: float) -> float:
        """Return a time step as a fraction of the ramp time, at most 1."""
        ramp = self.options.ramp_time
        return 1.0 if ramp <= 0.0 else min(1.0, dt / ramp)

    def _margin_of(self, source: TorqueSource | None) -> float:
        reach = math.inf if source is None else source.reach
        return min(self.options.extrapolation_margin, reach)

    def _is_near(self, source: TorqueSource, q: FloatArray) -> bool:
        margin = self._margin_of(source)
        return bool(((q >= source.q_min - margin) & (q <= source.q_max + margin)).all())

    def _is_at_rest(self) -> bool:
        return self._gain == 0.0 and not self._last.any()

    def _advanced(self, source: TorqueSource, q: FloatArray, dt: float) -> FloatArray:
        """Advance a swap and the share of a change by dt; return the torque (N,)."""
        share_step = self._share_goal - self._share
        if self._blend >= 1.0 and (source.before is None or not share_step.any()):
            return self._torque(source, q)
        ramp = self.options.ramp_time
        step = self._ramp_step(dt)
        blend, share = self._blend, self._share
        before = self._blended(source, q)

        def advance(fraction: float) -> FloatArray:
            self._blend = blend + fraction * min(step, 1.0 - blend)
            self._share = share + fraction * np.clip(share_step, -step, step)
            return self._blended(source, q)

        after = advance(1.0)
        # A late message must not make a larger step.
        limit = SWAP_CHANGE * min(dt, self._period()) / ramp if ramp > 0.0 else math.inf
        change = float(np.abs(after - before).max())
        return advance(limit / change) if change > limit else after

    def _blended(self, source: TorqueSource, q: FloatArray) -> FloatArray:
        new = self._torque(source, q)
        if self._blend >= 1.0 or self._old is None:
            return new
        old = self._torque(self._old, q) + self._offset
        return old + self._blend * (new - old)

    def _torque(self, source: TorqueSource, q: FloatArray) -> FloatArray:
        predict = source.with_share(self._share)
        if self.options.extrapolation == 'trust':
            return predict(q)
        nearest = source.nearest(q)
        if nearest is q:
            # Within the trained range.
            return predict(q)
        q = nearest
        margin = self._margin_of(source)
        inside = np.minimum(np.maximum(q, source.q_min - margin), source.q_max + margin)
        outside = float(np.abs(q - inside).max())
        if outside == 0.0:
            return predict(q)
        if self.options.extrapolation == 'hold':
            return predict(inside)
        return predict(q) * max(0.0, 1.0 - outside / margin)

    def _limited(self, dt: float) -> FloatArray:
        goal = self._gain * (self._base + self._effects)
        if self._limit is not None:
            goal = np.minimum(np.maximum(goal, -self._limit), self._limit)
        if self._rate is not None:
            step = self._rate * dt
            goal = np.minimum(np.maximum(goal, self._last - step), self._last + step)
        if self._limit is not None:
            # Again: a lowered limit applies at once, not at the maximum rate.
            goal = np.minimum(np.maximum(goal, -self._limit), self._limit)
        self._last = goal
        return goal
