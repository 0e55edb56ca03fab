"""The torque that is published: ramped, clamped, and safe when input stops."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
import math

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.data.short_vectors import all_finite
from gravity_comp_ros.node.feedforward_options import FeedForwardOptions, per_joint
from gravity_comp_ros.node.source import Source
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

# N·m; less than this of an effect's torque is none.
LEAST_TORQUE = 1e-4
# A message counts for at most so many of its usual periods: what a stall has missed is made up
# for over the messages that follow, not in one step.
PERIODS = 2.0
# Messages over which the usual period is the median, and the least that it is taken for, s.
PERIOD_MESSAGES, LEAST_PERIOD = 20, 1e-3
# N·m within `ramp_time`: a larger change of the model takes longer. At the default of 1 s that is
# 0.048 N·m a message at 250 Hz.
SWAP_CHANGE = 12.0
# One call of the watchdog counts for at most this, s.
WATCH_PERIOD = 0.02


class FeedForward:
    """
    Torque for every pose, with explicit time: `now` in s never has to be the system's.

    A gain between 0 and 1 multiplies the model's torque. It rises over `ramp_time` when a
    first model, input or permission comes, and falls when permission goes or input is stale
    for longer than `hold_time`. From one model to the next torque is blended over the same
    time, a change of more than `SWAP_CHANGE` over a longer one. Limits act on the sum of it
    all, so nothing that is published breaks them.

    :param n_joints: the number N of joints.
    """

    def __init__(self, n_joints: int, options: FeedForwardOptions) -> None:
        self._n = n_joints
        self._enabled = True
        self._gain = 0.0
        self._blend = 1.0
        self._source: Source | None = None
        self._old: Source | None = None
        # What the torque was beside that of `_old` as the blend began, N·m.
        self._offset = np.zeros(n_joints)
        self._q: FloatArray | None = None
        self._share, self._share_goal = np.ones(n_joints), np.ones(n_joints)
        self._base = np.zeros(n_joints)
        self._effects = np.zeros(n_joints)
        self._last = np.zeros(n_joints)
        self._now: float | None = None
        # Time that passed in a stall and that no message has counted for yet, s.
        self._owed = 0.0
        self._intervals: deque[float] = deque(maxlen=PERIOD_MESSAGES)
        self._fresh: float | None = None
        self.set_options(options)

    def set_options(self, options: FeedForwardOptions) -> None:
        """Use other limits and times from now on."""
        self.options = options
        self._limit = per_joint(options.max_torque, self._n)
        self._rate = per_joint(options.max_torque_rate, self._n)

    def use(self, source: Source | None, share: FloatArray | None = None) -> None:
        """
        Go over to another model, or to none: then nothing is published.

        :param share: of the change from `source.before` (N,), 0 to 1; None for all of it.
        """
        if source is None or self._source is None:
            self._gain = 0.0 if source is None else self._gain
            self._old, self._blend = None, 1.0
        else:
            # A swap during a swap starts from the torque of this moment. It goes on with the
            # pose: the arm moves while it is blended.
            self._offset = np.zeros(self._n)
            if self._blend < 1.0 and self._q is not None:
                self._offset = self._base - self._torque(self._source, self._q)
            old = self._source
            self._old = replace(old, predict=old.with_share(self._share.copy()), before=None)
            self._blend = 0.0
        self._source = source
        self._share = np.ones(self._n) if share is None else share
        self._share_goal = self._share

    def set_share(self, share: FloatArray) -> None:
        """Go over to another share of the change, as slowly as to another model."""
        self._share_goal = share

    def enable(self, enabled: bool) -> None:
        """Allow or forbid torque; it ramps either way."""
        self._enabled = enabled

    @property
    def enabled(self) -> bool:
        return self._enabled

    @property
    def margin(self) -> float:
        """How far outside its trained range the model is used as it is, rad."""
        reach = math.inf if self._source is None else self._source.reach
        return min(self.options.extrapolation_margin, reach)

    def update(self, now: float, q: FloatArray,
               effects: FloatArray | None = None) -> FloatArray | None:
        """
        Return the torque (N,) in N·m to publish at pose `q` (N,), None for nothing.

        A model that returns no finite torque counts as no input: the watchdog takes over.

        :param effects: torque (N,) in N·m that comes on top of gravity, within the margin of
            the trained range; past it, and while input is stale, it ramps away.
        """
        dt = self._since_last_message(now)
        if self._source is None:
            self._fresh = now
            return None
        base = self._advanced(self._source, q, dt)
        if not all_finite(base):
            return None
        self._fresh, self._base, self._q = now, base, q
        if effects is not None and self._is_near(self._source, q) and np.isfinite(effects).all():
            self._effects = effects
        else:
            self._drop_effects(dt)
        silent = not self._enabled and self._is_at_rest()
        self._approach(1.0 if self._enabled else 0.0, self.options.ramp_time, dt)
        return None if silent else self._limited(dt)

    def watch(self, now: float) -> FloatArray | None:
        """Return the torque to publish although no input came, None if none is due."""
        if self._fresh is None or self._source is None:
            return None
        # A clock that was set back must not make old input young for as long as that.
        self._fresh = min(self._fresh, now)
        age = now - self._fresh
        if age <= self.options.stale_after:
            return None
        self._owed = 0.0
        dt = min(self._elapsed(now), max(WATCH_PERIOD, PERIODS * self._period()))
        if self._is_at_rest():
            return None
        # What turns with the direction of motion must not outlive the news of the motion.
        self._drop_effects(dt)
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
        """Return the time since the last call; a clock that jumps gives no licence to jump."""
        dt = 0.0 if self._now is None else now - self._now
        self._now = now
        return min(max(dt, 0.0), self.options.stale_after)

    def _since_last_message(self, now: float) -> float:
        """Return the time that a message counts for: after a stall, not all that has passed."""
        dt = self._elapsed(now)
        counted = dt
        if self._intervals:
            counted = min(dt + self._owed, PERIODS * self._period())
        self._owed = min(max(0.0, self._owed + dt - counted), self.options.stale_after)
        if dt > 0.0:
            self._intervals.append(dt)
        return counted

    def _period(self) -> float:
        """Return the usual time between messages, s."""
        every = sorted(self._intervals)
        return max(LEAST_PERIOD, every[len(every) // 2]) if every else LEAST_PERIOD

    def _approach(self, goal: float, duration: float, dt: float) -> None:
        step = 1.0 if duration <= 0.0 else dt / duration
        self._gain += min(max(goal - self._gain, -step), step)

    def _drop_effects(self, dt: float) -> None:
        ramp = self.options.ramp_time
        if self._effects.any():
            self._effects = self._effects * (max(0.0, 1.0 - dt / ramp) if ramp > dt else 0.0)
            self._effects[np.abs(self._effects) < LEAST_TORQUE] = 0.0

    def _is_near(self, source: Source, q: FloatArray) -> bool:
        margin = min(self.options.extrapolation_margin, source.reach)
        return bool(((q >= source.q_min - margin) & (q <= source.q_max + margin)).all())

    def _is_at_rest(self) -> bool:
        return self._gain == 0.0 and not self._last.any()

    def _advanced(self, source: Source, q: FloatArray, dt: float) -> FloatArray:
        """Go on with a swap and with the share of a change; return the torque (N,)."""
        share_left = self._share_goal - self._share
        if self._blend >= 1.0 and (source.before is None or not share_left.any()):
            return self._torque(source, q)
        ramp = self.options.ramp_time
        step = 1.0 if ramp <= 0.0 else min(1.0, dt / ramp)
        blend, share = self._blend, self._share
        before = self._blended(source, q)

        def go(part: float) -> FloatArray:
            self._blend = blend + part * min(step, 1.0 - blend)
            self._share = share + part * np.clip(share_left, -step, step)
            return self._blended(source, q)

        after = go(1.0)
        # A message that comes late makes no larger step.
        most = SWAP_CHANGE * min(dt, self._period()) / ramp if ramp > 0.0 else math.inf
        change = float(np.abs(after - before).max())
        return go(most / change) if change > most else after

    def _blended(self, source: Source, q: FloatArray) -> FloatArray:
        new = self._torque(source, q)
        if self._blend >= 1.0 or self._old is None:
            return new
        old = self._torque(self._old, q) + self._offset
        return old + self._blend * (new - old)

    def _torque(self, source: Source, q: FloatArray) -> FloatArray:
        predict = source.with_share(self._share)
        if self.options.extrapolation == 'trust':
            return predict(q)
        near = source.nearest(q)
        if near is q:
            # Within the trained range.
            return predict(q)
        q = near
        margin = min(self.options.extrapolation_margin, source.reach)
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
            # Again, because a limit that was lowered just now is not to be approached slowly.
            goal = np.minimum(np.maximum(goal, -self._limit), self._limit)
        self._last = goal
        return goal
