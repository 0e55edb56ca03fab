"""Conversion of `sensor_msgs/JointState` to vectors in the configured order; faults by name."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any, get_args, Literal

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.gravity_model import Coverage
from gravity_comp_ros.node.options import NODE, REVOLUTION
import numpy as np

# The message or the faulty field is dropped; the slope of position replaces a wrong velocity.
Fault = Literal[
    'missing_joint', 'duplicate_joint', 'wrong_size', 'position_not_finite', 'position_absurd',
    'time_back', 'time_still', 'too_old', 'from_future', 'velocity_not_finite',
    'velocity_wrong', 'effort_not_finite', 'effort_absurd', 'no_effort', 'clock_jump']
# Counted, without a warning.
Handled = Literal['other_joints', 'no_velocity', 'no_stamp']
Reason = Fault | Handled
FAULTS: tuple[Fault, ...] = get_args(Fault)
HANDLED: tuple[Handled, ...] = get_args(Handled)


@dataclass(eq=False)
class Reading:
    """
    The content of a message about the joints of the arm, in the configured order.

    `t` in s, `q` (N,) in rad; `qd` (N,) in rad/s and `tau` (N,) in N·m are None where the
    message does not contain them. `new_run` is true if the clock or the count of revolutions
    started again before it.
    """

    t: float
    q: FloatArray
    qd: FloatArray | None
    tau: FloatArray | None
    new_run: bool = False


@dataclass(eq=False)
class CompleteReading(Reading):
    """A reading with velocity and torque, as learning requires."""

    qd: FloatArray
    tau: FloatArray


def nearest_revolution(trained: Coverage, q: FloatArray, last: FloatArray) -> FloatArray:
    """
    Return a pose q (N,) whose joints outside the trained range are in the nearest revolution.

    A driver may wrap an angle, or count revolutions in another way after a start. Gravity is the
    same; a spring is not, and a change of the model would widen the range by a revolution. Half a
    revolution from the middle of the range another pose becomes the nearest one, and a held torque
    another torque: for `NODE.turn_margin` more, the pose goes on from the `last` one (N,).
    """
    outside = trained.distance(q) > 0.0
    if not outside.any():
        return q
    middle = 0.5 * (trained.q_min + trained.q_max)
    kept = np.maximum(trained.q_max - middle, math.pi) + NODE.turn_margin
    nearest, further = (q - REVOLUTION * np.round((q - near) / REVOLUTION)
                        for near in (middle, last))
    # NaN of no last pose is not near.
    nearest = np.where(np.abs(further - middle) <= kept, further, nearest)
    return np.where(outside, nearest, q)


class JointStateReader:
    """
    Reads messages of one arm; counts every fault by its reason in `counts`.

    :param effort_scale: N·m per unit of effort, one for all, one per joint, or none for 1.
    :param continuous: the continuous joints.
    :param max_age: largest difference of a stamp from the time of arrival, s; 0 for any.
    """

    def __init__(self, joints: Sequence[str], effort_scale: Sequence[float] = (),
                 continuous: Sequence[str] = (), max_age: float = 0.0) -> None:
        self.joints = tuple(joints)
        self.max_age = max_age
        # Difference of the last stamp from its time of arrival, s.
        self.age = 0.0
        self.counts: Counter[Reason] = Counter()
        self.received = 0
        self._reported, self._reported_received = Counter[Reason](), 0
        # Whether messages of the last report had earlier or equal stamps.
        self.are_out_of_order = False
        self._scale = np.broadcast_to(np.array(effort_scale or (1.0,)), (len(joints),))
        self._max_effort = FactOptions().max_torque / np.abs(self._scale)
        self._largest = np.full(len(joints), FactOptions().max_angle)
        self.allow_continuous(continuous)
        self._names: list[str] | None = None
        self._order = np.zeros(0, dtype=np.intp)
        self._last, self._had_no_stamp = -np.inf, False
        # The trained range of the model in use, and the last pose.
        self.trained: Coverage | None = None
        self._q = np.full(len(joints), np.nan)
        # Stamps of consecutive messages that were rejected as earlier.
        self._rejected: list[float] = []
        # Time, position and velocity of the messages within the slope window.
        self._past: deque[tuple[float, FloatArray, FloatArray]] = deque()

    def allow_continuous(self, continuous: Sequence[str]) -> None:
        """Treat more joints as continuous."""
        for k, name in enumerate(self.joints):
            if name in continuous:
                self._largest[k] = NODE.max_continuous

    def take_new(self) -> tuple[int, Counter[Reason]]:
        """Return the number of messages, and the counts by reason, since the last call."""
        new = self.received - self._reported_received
        counts = self.counts - self._reported
        self._reported, self._reported_received = self.counts.copy(), self.received
        self.are_out_of_order = counts['time_back'] + counts['time_still'] > 0
        return new, counts

    def read(self, message: Any, arrival: float) -> Reading | None:
        """
        Return the reading of a message, None if it cannot be used.

        :param message: a `sensor_msgs/JointState`.
        :param arrival: time of arrival in s on the clock of the stamps; it is the time of a
            message without a stamp, and determines the age of one with a stamp.
        """
        self.received += 1
        if message.name != self._names and not self._learn_order(message.name):
            return None
        q = self._vector(message.position, 'position_not_finite')
        if q is None:
            return None
        if not (np.abs(q) <= self._largest).all():
            self.counts['position_absurd'] += 1
            return None
        stamp = message.header.stamp
        t = stamp.sec + 1e-9 * stamp.nanosec
        # The time of arrival may be of another clock, as where a simulation begins at 0.
        new_run, self._had_no_stamp = self._had_no_stamp and t != 0.0, t == 0.0
        if t == 0.0:
            self.counts['no_stamp'] += 1
            t = arrival
        elif not self._is_recent(arrival - t):
            return None
        if t <= self._last and not new_run:
            if not self._clock_was_set_back(t):
                self.counts['time_still' if t == self._last else 'time_back'] += 1
                return None
            new_run = True
            self.counts['clock_jump'] += 1
        self._rejected.clear()
        before = self._q
        if self.trained is not None:
            q = nearest_revolution(self.trained, q, before)
        new_run |= bool((np.abs(q - before) > 0.5 * REVOLUTION).any())
        if new_run:
            self._past.clear()
        self._last, self._q = t, q
        qd = self._velocity(message.velocity, t, q)
        tau = self._effort(message.effort)
        if qd is None or tau is None:
            return Reading(t, q, qd, tau, new_run)
        return CompleteReading(t, q, qd, tau, new_run)

    def _is_recent(self, age: float) -> bool:
        self.age = age
        if not self.max_age or abs(age) <= self.max_age:
            return True
        self.counts['too_old' if age > 0.0 else 'from_future'] += 1
        return False

    def _learn_order(self, names: Sequence[str]) -> bool:
        ours = [name for name in names if name in self.joints]
        if not ours:
            self.counts['other_joints'] += 1
            return False
        if len(set(ours)) != len(ours):
            self.counts['duplicate_joint'] += 1
            return False
        if len(ours) != len(self.joints):
            self.counts['missing_joint'] += 1
            return False
        self._names = names = list(names)
        self._order = np.array([names.index(name) for name in self.joints], dtype=np.intp)
        return True

    def _vector(self, values: Sequence[float], not_finite: Reason) -> FloatArray | None:
        """Return values (N,) in the configured order; count a wrong size or values not finite."""
        if len(values) != len(self._names or ()):
            self.counts['wrong_size'] += 1
            return None
        vector = np.asarray(values, dtype=np.float64)[self._order]
        if not np.isfinite(vector).all():
            self.counts[not_finite] += 1
            return None
        return vector

    def _velocity(self, values: Sequence[float], t: float, q: FloatArray) -> FloatArray | None:
        if len(values) == 0:
            self.counts['no_velocity'] += 1
            return self._slope(t, q, np.zeros_like(q))[0]
        qd = self._vector(values, 'velocity_not_finite')
        if qd is None:
            return None
        slope, qd_then = self._slope(t, q, qd)
        if slope is not None:
            # The mean velocity of an accelerating joint lies between its first and its last one.
            fastest = np.maximum(np.abs(qd), np.abs(qd_then))
            limit = NODE.slope_factor * fastest + NODE.slope_margin
            if (np.abs(slope) > limit).any():
                self.counts['velocity_wrong'] += 1
                return slope
        return qd

    def _slope(self, t: float, q: FloatArray, qd: FloatArray
               ) -> tuple[FloatArray | None, FloatArray]:
        """Return the mean velocity over `NODE.slope_time`, and the velocity at its beginning."""
        past = self._past
        past.append((t, q, qd))
        while len(past) > 1 and past[1][0] <= t - NODE.slope_time:
            past.popleft()
        then, q_then, qd_then = past[0]
        # Stamps at 10 Hz are closer than this time by a rounding error.
        if not NODE.slope_time - 1e-6 <= t - then <= NODE.max_slope_time:
            return None, qd_then
        return (q - q_then) / (t - then), qd_then

    def _effort(self, values: Sequence[float]) -> FloatArray | None:
        if len(values) == 0:
            self.counts['no_effort'] += 1
            return None
        tau = self._vector(values, 'effort_not_finite')
        if tau is not None and not (np.abs(tau) <= self._max_effort).all():
            self.counts['effort_absurd'] += 1
            return None
        return None if tau is None else tau * self._scale

    def _clock_was_set_back(self, t: float) -> bool:
        """Return whether enough consecutive messages have earlier but rising stamps."""
        if self._rejected and t <= self._rejected[-1]:
            self._rejected.clear()
        self._rejected.append(t)
        return len(self._rejected) >= NODE.stamps
