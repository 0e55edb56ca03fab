"""
Watch of the residual of the model in use for a payload that was not announced.

It runs with each slow sample: it keeps the last samples of motion and requests a full test
(`payload_evidence`, in the fit process) where the residual exceeds the noise in each part of them.
A hand that presses straight down has the torque of a weight, so a change is suspected to be a
payload only after it has lasted for some time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
import math

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.node.payload import PARTS, PayloadFinding
import numpy as np

LEARN = 'learn'
# Minimum number of samples of a window, six seconds at the default rate, and the maximum, to which
# longer windows are thinned. A light payload with friction requires more samples than a heavy one.
# With the minimum, a contact shorter than two seconds is not present in each third.
MIN_WINDOW, MAX_WINDOW = 30, 75
# Lengths of windows relative to the shortest one that lasts long enough.
_RELATIVE_LENGTHS = (2.5, 5.0 / 3.0, 1.0)
# Minimum time between samples, s; closer samples are redundant.
PERIOD = 0.2
# Minimum motion between samples, rad; samples at rest are redundant.
_MIN_MOTION = 0.005
# Maximum mean acceleration, rad/s^2; above it inertia is not negligible.
MAX_ACCELERATION = 0.25
# A test is due where this share of the samples of each part has a joint with a residual of this
# many times the noise.
_MIN_SHARE, _LARGE = 0.75, 3.0
# RMS residual in units of noise below which a suspicion ends.
_NORMAL = 2.5
# Number of new samples before the next test.
_NEW_SAMPLES = 5


@dataclass(frozen=True)
class Suspicion:
    """Suspicion of another payload since `since` (stamp of the first sample in s)."""

    since: float
    text: str
    values: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class _Row:
    """A slow sample, its residual in units of noise, and whether that of any joint is large."""

    t: float
    q: FloatArray
    qd: FloatArray
    tau: FloatArray
    qdd: FloatArray
    ratio: FloatArray
    is_large: bool


class PayloadWatch:
    """
    The window of samples, and the findings in it.

    :param names: joint names.
    :param min_duration: duration in s of a change before it counts as a payload.
    """

    def __init__(self, names: tuple[str, ...], min_duration: float) -> None:
        self._names, self._min_duration = names, min_duration
        self.suspicion: Suspicion | None = None
        # Evidence of a change of the effort that no payload explains; empty if there is none.
        self.other = ''
        self.restart()

    def restart(self) -> None:
        """Drop the samples: the clock, the model or the payload has changed."""
        capacity = max(MAX_WINDOW, math.ceil(
            _RELATIVE_LENGTHS[0] * (self._min_duration / PERIOD + 1.0)))
        self._rows: deque[_Row] = deque(maxlen=capacity)
        self._wait = 0
        self._due: list[int] = []
        self._tests = 0
        # Duration of the tested window, s.
        self._duration = 0.0

    def forget(self) -> None:
        """Drop the samples and the findings."""
        self.restart()
        self.suspicion, self.other = None, ''

    def offer(self, t: float, q: FloatArray, qd: FloatArray, tau: FloatArray,
              qdd: FloatArray, ratio: FloatArray) -> None:
        """
        Add a slow sample at a pose within the trained range; arrays (N,) as in `JointSamples`.

        :param ratio: residual without friction in units of noise (N,).
        """
        rows = self._rows
        if rows and (t < rows[-1].t + 0.9 * PERIOD or
                     float(np.abs(q - rows[-1].q).max()) < _MIN_MOTION):
            return
        rows.append(_Row(t, q, qd, tau, qdd, ratio, float(np.abs(ratio).max()) > _LARGE))
        self._wait = max(0, self._wait - 1)
        self._due = self._due_lengths()
        if (self.suspicion is not None or self.other) and len(rows) >= MIN_WINDOW:
            recent = np.array([row.ratio for row in list(rows)[-MIN_WINDOW:]])
            if np.sqrt((recent ** 2).mean(axis=0)).max() < _NORMAL:
                self.suspicion, self.other = None, ''

    def is_due(self) -> bool:
        """Return whether a full test of the samples is due."""
        return self.suspicion is None and self._wait == 0 and bool(self._due)

    def window(self) -> JointSamples:
        """Return the samples to test; the next window has new samples and another length."""
        self._wait = _NEW_SAMPLES
        length = self._due[self._tests % len(self._due)]
        self._tests += 1
        rows = list(self._rows)[-length:]
        self._duration = rows[-1].t - rows[0].t
        picked = np.unique(
            np.linspace(0, length - 1, min(length, MAX_WINDOW)).round().astype(int))
        t, q, qd, tau, qdd = (np.array(column) for column in zip(
            *((row.t, row.q, row.qd, row.tau, row.qdd) for row in (rows[k] for k in picked))))
        return JointSamples.single_run(self._names, t, q, qd, tau, 'live', qdd=qdd)

    def add_finding(self, finding: PayloadFinding, since: float) -> Suspicion | None:
        """Record a finding; return a suspicion if it is new and has lasted long enough."""
        self.other = finding.text if finding.is_other else ''
        if not finding.is_payload or self.suspicion is not None or (
                self._duration < self._min_duration):
            return None
        self.suspicion = Suspicion(since, finding.text, finding.values)
        return self.suspicion

    def _due_lengths(self) -> list[int]:
        """Return the lengths of windows with a large residual in each part, longest first."""
        rows = list(self._rows)
        if len(rows) < MIN_WINDOW or not rows[-1].is_large:
            return []
        large = np.array([row.is_large for row in rows])
        enough = next((length for length in range(MIN_WINDOW, len(rows) + 1)
                       if large[-length]
                       and rows[-1].t - rows[-length].t >= self._min_duration), None)
        lengths = {min(len(rows), MAX_WINDOW), MIN_WINDOW}
        if enough is not None:
            lengths |= {length for length in
                        (math.ceil(factor * enough) for factor in _RELATIVE_LENGTHS)
                        if length <= len(rows)}
        return [length for length in sorted(lengths, reverse=True)
                if all(part.mean() >= _MIN_SHARE
                       for part in np.array_split(large[-length:], PARTS))]
