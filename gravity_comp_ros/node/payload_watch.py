"""
Watches the residual of the model in use for another payload that the node was not told of.

This part runs with every slow sample and is cheap: it keeps the last samples at which the arm
moved, and asks for a thorough look (`payload_evidence`, in the fit process) where the residual
exceeds the noise in each part of them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.node.payload import PARTS, PayloadFinding
import numpy as np

REPORT, LEARN = 'report', 'learn'
# Samples of motion that are looked at together: six to fifteen seconds at the default rate. A
# heavy payload shows in few, a light one beside friction in many. A contact that lasts for less
# than two seconds does not show in every third of the shortest window.
WINDOWS = (75, 50, 30)
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


class PayloadWatch:
    """
    The window, and what was found in it.

    :param names: joint names.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self.suspicion: Suspicion | None = None
        # Why the effort is thought to have changed as no payload changes it; empty if it has not.
        self.other = ''
        self.restart()

    def restart(self) -> None:
        """Forget the samples: the clock, the model or the payload is another."""
        self._rows: deque[tuple[float, FloatArray, FloatArray, FloatArray, FloatArray]] = deque(
            maxlen=WINDOWS[0])
        self._wait = 0

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
        if rows and (t <= rows[-1][0] or float(np.abs(q - rows[-1][1]).max()) < _MOVED):
            return
        rows.append((t, q, qd, tau, ratio))
        self._wait = max(0, self._wait - 1)
        if self.suspicion is not None or self.other:
            recent = self._ratios(WINDOWS[-1])
            if recent is not None and np.sqrt((recent ** 2).mean(axis=0)).max() < _NORMAL:
                self.suspicion, self.other = None, ''

    def is_due(self) -> bool:
        """Return whether the samples are worth a thorough look."""
        return self.suspicion is None and self._wait == 0 and self._long() is not None

    def window(self) -> JointSamples:
        """Return the samples to look at; the next look waits for new ones."""
        self._wait = _AGAIN
        rows = list(self._rows)[-(self._long() or WINDOWS[-1]):]
        t, q, qd, tau, _ = (np.array(column) for column in zip(*rows))
        return JointSamples.single_run(self._names, t, q, qd, tau, 'live')

    def found(self, finding: PayloadFinding, since: float) -> Suspicion | None:
        """Note what a look found; return a suspicion where it is new."""
        self.other = finding.text if finding.is_other else ''
        if not finding.is_payload or self.suspicion is not None:
            return None
        self.suspicion = Suspicion(since, finding.text, finding.values)
        return self.suspicion

    def _long(self) -> int | None:
        """Return the length of the longest window with a large residual in each part."""
        for length in WINDOWS:
            ratios = self._ratios(length)
            if ratios is not None and all(
                    np.quantile(part, 1.0 - _MOSTLY) > _LARGE
                    for part in np.array_split(ratios.max(axis=1), PARTS)):
                return length
        return None

    def _ratios(self, length: int) -> FloatArray | None:
        """Return the absolute residual of the last samples in multiples of the noise (M, N)."""
        if len(self._rows) < length:
            return None
        return np.abs([row[4] for row in list(self._rows)[-length:]])
