"""
Watches the residual of the model in use for another payload that the node was not told of.

This part runs with every slow sample and is cheap: it keeps the last samples at which the arm
moved, and asks for a thorough look (`payload_evidence`, in the fit process) where the residual
exceeds the noise in each part of them. A hand that presses straight down makes the torque of a
weight for as long as it presses, so a change counts as a payload only once it has lasted.
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
# The fewest samples of motion that are looked at together, six seconds at the default rate, and
# the most: longer windows are thinned. A heavy payload shows in few, a light one beside friction
# in many. A contact that lasts for less than two seconds does not show in every third of few.
FEWEST, MOST = 30, 75
# Windows of so many times the shortest that lasts long enough are looked at as well.
_LONGER = (2.5, 5.0 / 3.0, 1.0)
# s; samples closer to each other repeat each other.
PERIOD = 0.2
# An arm that moved less than this since the last sample is at rest: rest shows nothing new, rad.
_MOVED = 0.005
# A mean acceleration above this is inertia, not gravity, rad/s^2.
CALM = 0.25
# This share of the samples of each part has a joint whose residual exceeds the noise so many times
# where a look is worth it. The residual is normal again below the other number, RMS.
_MOSTLY, _LARGE, _NORMAL = 0.75, 3.0, 2.5
# New samples before the next look.
_AGAIN = 5


@dataclass(frozen=True)
class Suspicion:
    """Another payload is suspected since `since` (s, stamp of the first sample); see `values`."""

    since: float
    text: str
    values: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class _Row:
    """A slow sample, its residual in multiples of the noise, and whether any joint's is large."""

    t: float
    q: FloatArray
    qd: FloatArray
    tau: FloatArray
    ratio: FloatArray
    is_large: bool


class PayloadWatch:
    """
    The window, and what was found in it.

    :param names: joint names.
    :param lasting: s for which a change must last before it counts as a payload.
    """

    def __init__(self, names: tuple[str, ...], lasting: float) -> None:
        self._names, self._lasting = names, lasting
        self.suspicion: Suspicion | None = None
        # Why the effort is thought to have changed as no payload changes it; empty if it has not.
        self.other = ''
        self.restart()

    def restart(self) -> None:
        """Forget the samples: the clock, the model or the payload is another."""
        most = max(MOST, math.ceil(_LONGER[0] * (self._lasting / PERIOD + 1.0)))
        self._rows: deque[_Row] = deque(maxlen=most)
        self._wait = 0
        self._due: list[int] = []
        self._looks = 0
        # s; how long what is looked at has lasted.
        self._lasted = 0.0

    def forget(self) -> None:
        """Forget what was found as well."""
        self.restart()
        self.suspicion, self.other = None, ''

    def offer(self, t: float, q: FloatArray, qd: FloatArray, tau: FloatArray,
              ratio: FloatArray) -> None:
        """
        Take in a healthy slow sample at a pose within the trained range.

        :param ratio: residual beside friction in multiples of the noise (N,).
        """
        rows = self._rows
        if rows and (t < rows[-1].t + 0.9 * PERIOD or
                     float(np.abs(q - rows[-1].q).max()) < _MOVED):
            return
        rows.append(_Row(t, q, qd, tau, ratio, float(np.abs(ratio).max()) > _LARGE))
        self._wait = max(0, self._wait - 1)
        self._due = self._lengths()
        if (self.suspicion is not None or self.other) and len(rows) >= FEWEST:
            recent = np.array([row.ratio for row in list(rows)[-FEWEST:]])
            if np.sqrt((recent ** 2).mean(axis=0)).max() < _NORMAL:
                self.suspicion, self.other = None, ''

    def is_due(self) -> bool:
        """Return whether the samples are worth a thorough look."""
        return self.suspicion is None and self._wait == 0 and bool(self._due)

    def window(self) -> JointSamples:
        """Return the samples to look at; the next look waits for new ones, of another length."""
        self._wait = _AGAIN
        length = self._due[self._looks % len(self._due)]
        self._looks += 1
        rows = list(self._rows)[-length:]
        self._lasted = rows[-1].t - rows[0].t
        picked = np.unique(np.linspace(0, length - 1, min(length, MOST)).round().astype(int))
        t, q, qd, tau = (np.array(column) for column in zip(
            *((row.t, row.q, row.qd, row.tau) for row in (rows[k] for k in picked))))
        return JointSamples.single_run(self._names, t, q, qd, tau, 'live')

    def found(self, finding: PayloadFinding, since: float) -> Suspicion | None:
        """Note what a look found; return a suspicion that is new and has lasted long enough."""
        self.other = finding.text if finding.is_other else ''
        if not finding.is_payload or self.suspicion is not None or self._lasted < self._lasting:
            return None
        self.suspicion = Suspicion(since, finding.text, finding.values)
        return self.suspicion

    def _lengths(self) -> list[int]:
        """Return the lengths of the windows with a large residual in each part, longest first."""
        rows = list(self._rows)
        if len(rows) < FEWEST or not rows[-1].is_large:
            return []
        large = np.array([row.is_large for row in rows])
        enough = next((length for length in range(FEWEST, len(rows) + 1)
                       if large[-length] and rows[-1].t - rows[-length].t >= self._lasting), None)
        lengths = {min(len(rows), MOST), FEWEST}
        if enough is not None:
            lengths |= {length for length in (math.ceil(part * enough) for part in _LONGER)
                        if length <= len(rows)}
        return [length for length in sorted(lengths, reverse=True)
                if all(part.mean() >= _MOSTLY
                       for part in np.array_split(large[-length:], PARTS))]
