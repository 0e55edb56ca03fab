"""From `sensor_msgs/JointState` to vectors in the configured order, with every fault named."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.data.short_vectors import all_finite, Bounds
from gravity_comp_ros.errors import OptionError
import numpy as np

# Faults: the message, or its part, is dropped.
OTHER_JOINTS = 'other_joints'
MISSING_JOINT = 'missing_joint'
DUPLICATE_JOINT = 'duplicate_joint'
WRONG_SIZE = 'wrong_size'
POSITION_NOT_FINITE = 'position_not_finite'
POSITION_ABSURD = 'position_absurd'
TIME_BACK = 'time_back'
TIME_STILL = 'time_still'
VELOCITY_NOT_FINITE = 'velocity_not_finite'
EFFORT_NOT_FINITE = 'effort_not_finite'
NO_EFFORT = 'no_effort'
# Replaced by other evidence, with a warning: a velocity of a joint that contradicts its positions,
# and a stamp of 0 after real ones.
VELOCITY_WRONG = 'velocity_wrong'
STAMP_LOST = 'stamp_lost'
# Handled: counted, and told without alarm.
NO_VELOCITY = 'no_velocity'
NO_STAMP = 'no_stamp'
CLOCK_JUMP = 'clock_jump'

FAULTS = (MISSING_JOINT, DUPLICATE_JOINT, WRONG_SIZE, POSITION_NOT_FINITE, POSITION_ABSURD,
          TIME_BACK, TIME_STILL, VELOCITY_NOT_FINITE, EFFORT_NOT_FINITE, NO_EFFORT, CLOCK_JUMP)
REPLACED = (VELOCITY_WRONG, STAMP_LOST)
HANDLED = (OTHER_JOINTS, NO_VELOCITY, NO_STAMP)

# rad. Further from 0 no joint turns but a continuous one: angles in degrees are such. And a
# continuous joint that has turned so far is an encoder fault, not a pose.
ABSURD_POSITION, ABSURD_TURNS = 4.0 * math.pi, 1000.0
# So many messages in a row that agree among themselves that it is earlier than we thought
# mean that the clock was set back, or a recording started again.
RISING_TO_BELIEVE = 5
# Velocity is the mean slope over this time where the message brings none.
SLOPE_WINDOW = 0.1
SLOPE_LIMIT = 0.5
# Stamps of 10 Hz are a rounding error less than the window apart.
_SHORTEST = SLOPE_WINDOW - 1e-6
# Positions contradict velocity where they move faster than this many times it, and this, rad/s.
SLOPE_FACTOR, SLOPE_LEAST = 1.5, 0.05


@dataclass(eq=False)
class Reading:
    """
    What a message says about our joints, in the configured order.

    `t` in s, `q` (N,) in rad; `qd` (N,) in rad/s and `tau` (N,) in N·m are None where the
    message does not tell them. `new_run` says that the clock started again before it. `before`
    is the time in s and the velocity (N,) a tenth of a second or more earlier, None without any.
    """

    t: float
    q: FloatArray
    qd: FloatArray | None
    tau: FloatArray | None
    new_run: bool = False
    before: tuple[float, FloatArray] | None = None

    def acceleration(self) -> FloatArray | None:
        """Return the mean acceleration (N,) since `before` in rad/s^2, None if unknown."""
        if self.before is None or self.qd is None:
            return None
        return (self.qd - self.before[1]) / (self.t - self.before[0])


@dataclass(eq=False)
class WholeReading(Reading):
    """A reading that tells velocity and torque as well: the node learns from these."""

    qd: FloatArray
    tau: FloatArray


class Reader:
    """
    Reads messages of one arm; counts every fault by its reason in `counts`.

    :param joints: the joint names, in the order of the vectors.
    :param effort_scale: N·m per unit of effort, one for all, one per joint, or none for 1.
    :param continuous: the joints that may turn without end.
    :raises OptionError: if there is another number of scales, or a continuous joint is none.
    """

    def __init__(self, joints: Sequence[str], effort_scale: Sequence[float] = (),
                 continuous: Sequence[str] = ()) -> None:
        if strangers := sorted(set(continuous) - set(joints)):
            raise OptionError(f'continuous_joints: {", ".join(strangers)} is not among the joints '
                              f'{", ".join(joints)}')
        if len(effort_scale) not in (0, 1, len(joints)):
            raise OptionError(f'effort_scale has {len(effort_scale)} values for '
                              f'{len(joints)} joints')
        self.joints = tuple(joints)
        self.counts: Counter[str] = Counter()
        self.received = 0
        scale = effort_scale if effort_scale else (1.0,)
        self._scale = np.broadcast_to(np.asarray(scale, dtype=np.float64), (len(joints),))
        self._farthest = np.array([ABSURD_TURNS if name in continuous else ABSURD_POSITION
                                   for name in joints])
        self._possible = Bounds(self._farthest)
        self._names: list[str] | None = None
        self._size = 0
        self._order = np.zeros(0, dtype=np.intp)
        self._last = -np.inf
        self._stamped = False
        self._unstamped = 0
        self._rebellion: list[float] = []
        self._past: deque[tuple[float, FloatArray, FloatArray]] = deque()

    def allow_turns(self, continuous: Sequence[str]) -> None:
        """Take joints for continuous, on top of those that are."""
        for k, name in enumerate(self.joints):
            if name in continuous:
                self._farthest[k] = ABSURD_TURNS
        self._possible = Bounds(self._farthest)

    def read(self, message: Any, arrival: float) -> Reading | None:
        """
        Return what `message` says, or None if it cannot be used.

        :param message: a `sensor_msgs/JointState`.
        :param arrival: time of arrival in s, used where the message has no stamp.
        """
        self.received += 1
        if message.name != self._names and not self._learn_order(message.name):
            return None
        q = self._vector(message.position)
        if q is None:
            self.counts[WRONG_SIZE] += 1
            return None
        if not all_finite(q):
            self.counts[POSITION_NOT_FINITE] += 1
            return None
        if not self._possible.contain(q):
            self.counts[POSITION_ABSURD] += 1
            return None
        stamp = message.header.stamp
        t = stamp.sec + 1e-9 * stamp.nanosec
        new_run = self._lost_stamps(t)
        if t == 0.0 and not self._stamped:
            self.counts[NO_STAMP] += 1
            t = arrival
        elif not self._stamped:
            # A simulation that begins at 0 looks like no stamp at all, for one message.
            self._stamped, new_run = True, self._last > -np.inf
            self._past.clear()
        if t <= self._last and not new_run:
            if not self._believe(t):
                self.counts[TIME_STILL if t == self._last else TIME_BACK] += 1
                return None
            new_run = True
            self.counts[CLOCK_JUMP] += 1
            self._past.clear()
        self._rebellion.clear()
        self._last = t
        qd = self._velocity(message.velocity, t, q)
        tau = self._effort(message.effort)
        if qd is None or tau is None:
            return Reading(t, q, qd, tau, new_run, self._before(t))
        return WholeReading(t, q, qd, tau, new_run, self._before(t))

    def _before(self, t: float) -> tuple[float, FloatArray] | None:
        if not self._past or not _SHORTEST <= t - self._past[0][0] <= SLOPE_LIMIT:
            return None
        return self._past[0][0], self._past[0][2]

    def _lost_stamps(self, t: float) -> bool:
        """Return whether from this message on the time of arrival counts, after real stamps."""
        self._unstamped = self._unstamped + 1 if t == 0.0 and self._stamped else 0
        if self._unstamped < RISING_TO_BELIEVE:
            return False
        self._unstamped, self._stamped = 0, False
        self.counts[STAMP_LOST] += 1
        self._past.clear()
        return True

    def _learn_order(self, names: Sequence[str]) -> bool:
        ours = [name for name in names if name in self.joints]
        if not ours:
            self.counts[OTHER_JOINTS] += 1
            return False
        if len(set(ours)) != len(ours):
            self.counts[DUPLICATE_JOINT] += 1
            return False
        if len(ours) != len(self.joints):
            self.counts[MISSING_JOINT] += 1
            return False
        names = list(names)
        self._order = np.array([names.index(name) for name in self.joints], dtype=np.intp)
        self._names, self._size = names, len(names)
        return True

    def _vector(self, values: Sequence[float]) -> FloatArray | None:
        if len(values) != self._size:
            return None
        return np.asarray(values, dtype=np.float64)[self._order]

    def _velocity(self, values: Sequence[float], t: float, q: FloatArray) -> FloatArray | None:
        if len(values) == 0:
            self.counts[NO_VELOCITY] += 1
            slope, _ = self._slope(t, q, np.zeros_like(q))
            if slope is not None:
                # The next slope over the window is compared with this one.
                self._past[-1] = (t, q, slope)
            return slope
        qd = self._vector(values)
        if qd is None:
            self.counts[WRONG_SIZE] += 1
            return None
        if not all_finite(qd):
            self.counts[VELOCITY_NOT_FINITE] += 1
            return None
        slope, qd_then = self._slope(t, q, qd)
        if slope is not None:
            # Between two velocities of a joint that speeds up or slows down lies its mean.
            most = SLOPE_FACTOR * np.maximum(np.abs(qd), np.abs(qd_then)) + SLOPE_LEAST
            if (np.abs(slope) > most).any():
                self.counts[VELOCITY_WRONG] += 1
                return slope
        return qd

    def _slope(self, t: float, q: FloatArray, qd: FloatArray
               ) -> tuple[FloatArray | None, FloatArray]:
        """Return the mean velocity over `SLOPE_WINDOW`, and the velocity at its beginning."""
        past = self._past
        past.append((t, q, qd))
        while len(past) > 1 and past[1][0] <= t - SLOPE_WINDOW:
            past.popleft()
        then, q_then, qd_then = past[0]
        if not _SHORTEST <= t - then <= SLOPE_LIMIT:
            return None, qd_then
        return (q - q_then) / (t - then), qd_then

    def _effort(self, values: Sequence[float]) -> FloatArray | None:
        if len(values) == 0:
            self.counts[NO_EFFORT] += 1
            return None
        tau = self._vector(values)
        if tau is None:
            self.counts[WRONG_SIZE] += 1
        elif not all_finite(tau):
            self.counts[EFFORT_NOT_FINITE] += 1
            return None
        return None if tau is None else tau * self._scale

    def _believe(self, t: float) -> bool:
        """Return whether the clock has been set back for good."""
        if self._rebellion and t <= self._rebellion[-1]:
            self._rebellion.clear()
        self._rebellion.append(t)
        return len(self._rebellion) >= RISING_TO_BELIEVE
