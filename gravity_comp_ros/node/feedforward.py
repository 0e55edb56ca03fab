"""
Feed-forward torque: bumpless, limited, and with a watchdog for input that stops.

One rule makes every transition bumpless. The target is the torque that is due now: that of the
model at the present pose, a held torque, or zero. When the target is redefined (another model,
limit or margin, another revolution of a joint, torque enabled or disabled, input lost or
returned), the offset of the torque published last from the new target begins to fall linearly to
zero,

    published = target + offset,    between the torque published last and the target,

so that the torque follows the pose and never moves away from its target.
Then the limits of rate and size apply.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import Coverage
from gravity_comp_ros.node.options import NODE
from gravity_comp_ros.node.parameters import Parameters
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


# The static torque (N,) in N·m at a pose (N,) in rad.
Torque = Callable[[FloatArray], FloatArray]


class FeedForward:
    """Torque for each pose; the caller passes the time `now` in s."""

    def __init__(self, n_joints: int, options: Parameters) -> None:
        self._n = n_joints
        # The torque published last, N·m.
        self.last = self._zero = np.zeros(n_joints)
        # Whether torque is allowed; it ramps either way.
        self.enabled = True
        self._predict: Torque | None = None
        self._coverage, self._reach = Coverage(self._zero, self._zero, 0), math.inf
        # Number of changes of the torque that is due at a pose: another model or revolution.
        self._changes = 0
        # Time of the last message with a torque, and of the last call.
        self._fresh: float | None = None
        self._now: float | None = None
        self.restart()
        self.set_options(options)

    def set_options(self, options: Parameters) -> None:
        """Use other limits and times from now on."""
        self.options = options
        self._limit, self._rate = (
            np.broadcast_to(np.asarray(values, dtype=np.float64), (self._n,)) if values else None
            for values in (options.max_torque, options.max_torque_rate))

    def use(self, predict: Torque, coverage: Coverage, reach: float = math.inf) -> None:
        """
        Change to the torque of another model.

        :param coverage: its trained range. :param reach: bounds the margin of extrapolation, rad.
        """
        self._predict, self._coverage, self._reach = predict, coverage, reach
        self._changes += 1

    def fail(self) -> None:
        """Treat the input as lost: `watch`, whose clock may be another, ends the torque."""
        self.options = replace(self.options, stale_action='fade', hold_time=0.0)
        self._fresh, self._now = -math.inf, None

    def restart(self) -> None:
        """Forget the input; with the next message torque goes on from that published last."""
        self._offset = self._speed = self._zero
        # The definition of the present target.
        self._phase: tuple[object, ...] = ()
        self._pose: FloatArray | None = None
        self._fresh = self._now = None
        # Mean period of the messages, s; 0 before there are two.
        self._period = 0.0

    @property
    def is_publishing(self) -> bool:
        """True while torque is published."""
        return bool(self.last.any())

    @property
    def margin(self) -> float:
        """Distance outside the trained range up to which the model is used unchanged, rad."""
        return min(self.options.extrapolation_margin, self._reach)

    def update(self, now: float, q: FloatArray) -> FloatArray | None:
        """
        Return the torque (N,) in N·m to publish at pose `q` (N,), rad, None for nothing.

        A torque of the model that is not finite counts as missing input for the watchdog.
        """
        dt, predict = self._step(now, is_message=True), self._predict
        if predict is None:
            self._fresh = now
            return None
        before, self._pose, range_ = self._pose, q, self._coverage
        self._changes += before is not None and bool((np.abs(q - before) > math.pi).any())
        # Beyond the margin the torque is that of the nearest pose within it.
        torque = predict(np.minimum(np.maximum(q, range_.q_min - self.margin),
                                    range_.q_max + self.margin))
        if not np.isfinite(torque).all():
            return None
        self._fresh = now
        if self._due(now) == DISABLED:
            return None if self._is_at_rest() else self._published(self._zero, (DISABLED,), dt)
        return self._published(self._clipped(torque), (
            ACTIVE, self._changes, self.margin, self.options.max_torque), dt)

    def watch(self, now: float) -> FloatArray | None:
        """Return the torque to publish without input, None if none is due."""
        if self._fresh is None or self._predict is None:
            return None
        # After the clock was set back, old input must not count as recent.
        self._fresh = min(self._fresh, now)
        due = self._due(now)
        if due == ACTIVE or (due == DISABLED and not self._is_stale(now)):
            return None
        dt = self._step(now, is_message=False)
        if self._is_at_rest():
            return None
        return self._published(self.last if due == HOLDING else self._zero, (due,), dt)

    def state(self, now: float) -> str:
        """Return the state, one of the constants above."""
        if self._predict is None:
            return NO_MODEL
        if self._fresh is None:
            return WAITING
        due = self._due(now)
        if due == ACTIVE:
            return RAMPING if self._offset.any() else ACTIVE
        if self._is_at_rest():
            return DISABLED if due == DISABLED else FADED
        return RAMPING if due == DISABLED else due

    def _due(self, now: float) -> str:
        """Return the state of the target: that of the model, none, the held one, or its fade."""
        if not self.enabled:
            return DISABLED
        if self.options.stale_action == 'fade' and self._is_stale(now - self.options.hold_time):
            return FADING
        return HOLDING if self._is_stale(now) else ACTIVE

    def _is_stale(self, now: float) -> bool:
        return self._fresh is not None and now - self._fresh > self.options.stale_after

    def _is_at_rest(self) -> bool:
        return not self.is_publishing and self._phase[:1] != (ACTIVE,)

    def _begin(self, phase: tuple[object, ...], target: FloatArray) -> None:
        """Begin a transition from the torque published last to another target."""
        self._phase, options = phase, self.options
        seconds = options.fade_time if phase == (FADING,) else options.ramp_time
        self._offset = self.last - target if seconds > 0.0 else self._zero
        self._speed = np.abs(self._offset) / max(seconds, 1e-9)
        if phase[0] == ACTIVE and self._limit is not None and seconds > 0.0:
            self._speed = np.minimum(self._speed, NODE.ramp_share * self._limit / seconds)

    def _published(self, target: FloatArray, phase: tuple[object, ...], dt: float) -> FloatArray:
        """Return the torque on the way to `target` after a time step dt, within limits."""
        if phase != self._phase:
            self._begin(phase, target)
        last, torque = self.last, target
        if self._offset.any():
            step = self._speed * dt
            offset = self._offset - np.minimum(np.maximum(self._offset, -step), step)
            offset[np.abs(offset) < NODE.rounding] = 0.0
            self._offset = np.minimum(np.maximum(offset, np.minimum(last - target, 0.0)),
                                      np.maximum(last - target, 0.0))
            torque = target + self._offset
        if self._rate is not None:
            step = self._rate * dt
            torque = np.minimum(np.maximum(torque, last - step), last + step)
        # A lowered limit applies at once, not at the maximum rate.
        self.last = self._clipped(torque)
        return self.last

    def _clipped(self, torque: FloatArray) -> FloatArray:
        if self._limit is None:
            return torque
        return np.minimum(np.maximum(torque, -self._limit), self._limit)

    def _step(self, now: float, is_message: bool) -> float:
        """
        Return the time step since the last call.

        It is at most `stale_after`, because the clock may jump, and some mean periods of the
        messages, so that the first one after a stall makes no large step.
        """
        dt = 0.0 if self._now is None else max(now - self._now, 0.0)
        dt, self._now = min(dt, self.options.stale_after), now
        longest = NODE.max_periods * self._period or dt
        if not is_message:
            return min(dt, max(NODE.watch_period, longest))
        dt = min(dt, longest)
        if dt > 0.0:
            share = 1.0 / NODE.period_messages if self._period else 1.0
            self._period += share * (dt - self._period)
        return dt
