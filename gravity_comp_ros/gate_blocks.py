"""The slow-motion gate for a run that comes in blocks, so that no recording need fit in memory."""

from __future__ import annotations

from collections import Counter

from gravity_comp_ros.gate import (
    ACCELERATING, accelerating, FAST, GateOptions, per_joint, RATE, slots_of)
from gravity_comp_ros.samples import BoolArray, FloatArray
import numpy as np


class BlockGate:
    """
    `slow_samples` of one run, block after block, with the same answer.

    :param n_joints: the number N of joints.
    :raises OptionError: if the options hold another number of thresholds.
    """

    def __init__(self, n_joints: int, options: GateOptions = GateOptions()) -> None:
        options.check_joints(n_joints)
        self._options = options
        self._max_speed = per_joint(options.max_speed, n_joints)
        self._limit = (None if options.max_acceleration is None
                       else per_joint(options.max_acceleration, n_joints))
        self._first: float | None = None
        self._last_slot = -np.inf
        # What the acceleration of the next sample may refer to.
        self._recent_t, self._recent_qd = np.zeros(0), np.zeros((0, n_joints))
        self.dropped: Counter[str] = Counter()

    def offer(self, t: FloatArray, qd: FloatArray) -> BoolArray:
        """
        Return which samples of the next block pass, shape (M,).

        :param t: times (M,) in s, all later than those before.
        :param qd: velocities (M, N) in rad/s.
        """
        if not len(t):
            return np.zeros(0, dtype=bool)
        if self._first is None:
            self._first = float(t[0])
        fast = np.any(np.abs(qd) > self._max_speed, axis=1)
        jerky = self._jerky(t, qd) & ~fast
        slow = np.flatnonzero(~(fast | jerky))
        kept = np.zeros(len(t), dtype=bool)
        kept[slow[self._one_per_slot(t[slow], self._first)]] = True
        for reason, lost in ((FAST, fast), (ACCELERATING, jerky), (RATE, ~(fast | jerky | kept))):
            if lost.any():
                self.dropped[reason] += int(lost.sum())
        return kept

    def _one_per_slot(self, t: FloatArray, first: float) -> BoolArray:
        if self._options.rate_hz is None or not len(t):
            return np.ones(len(t), dtype=bool)
        slots = slots_of(t, first, self._options.rate_hz)
        fresh = np.concatenate([[slots[0] > self._last_slot], slots[1:] > slots[:-1]])
        self._last_slot = max(self._last_slot, float(slots[-1]))
        return fresh

    def _jerky(self, t: FloatArray, qd: FloatArray) -> BoolArray:
        if self._limit is None:
            return np.zeros(len(t), dtype=bool)
        window = self._options.acceleration_window
        times = np.concatenate([self._recent_t, t])
        speeds = np.concatenate([self._recent_qd, qd])
        found = accelerating(times, speeds, self._limit, window)[len(self._recent_t):]
        begin = max(int(np.searchsorted(times, times[-1] - window, side='right')) - 1, 0)
        self._recent_t, self._recent_qd = times[begin:].copy(), speeds[begin:].copy()
        return found
