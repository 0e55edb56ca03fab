"""
Watch of the model in use on new slow samples.

Two questions are asked of the same residual. Is a new model worse than the previous one? Then it
is rolled back. Has the payload changed without a call of `~/payload_changed`? Then the fit process
tests the window (`acceptance.suspicion_checks`).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
import math

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.evaluation.expected_residual import expected_residual, residual_noise
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node import checks
from gravity_comp_ros.node.checks import Check
from gravity_comp_ros.node.hypotheses import PARTS
from gravity_comp_ros.node.job_messages import PayloadResult
from gravity_comp_ros.node.messages import CompleteReading
import numpy as np

LEARN = 'learn'
# Number of slow samples of a new model that are judged together, 3 s at the default rate.
WINDOW = 15
# Residual in units of noise up to which a sample is predicted, and from which a window is not.
GOOD, BAD = 4.0, 6.0
# Largest ratio of the previous model's residual to that of the model in use for a rollback.
MAX_RATIO = 0.5
# Largest number of samples required to confirm a model.
MAX_REQUIRED = 200
# Minimum number of samples of a window for a payload test, six seconds at the default rate, and
# the maximum, to which longer windows are thinned. A light payload with friction requires more
# samples than a heavy one. With the minimum, a contact shorter than two seconds is not present in
# each third.
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


@dataclass(frozen=True, eq=False)
class _Row:
    """A slow sample, its acceleration, and its residual in units of the noise, (N,) each."""

    reading: CompleteReading
    qdd: FloatArray
    ratio: FloatArray


class Watch:
    """
    The new samples of the model in use, and the findings in them.

    A model is confirmed once it has predicted as many new samples as it was trained on. A hand
    that presses straight down has the torque of a weight, so a change is suspected to be a
    payload only after it has lasted for some time.

    :param names: joint names.
    :param min_duration: duration in s of a change before it counts as a payload.
    """

    def __init__(self, names: tuple[str, ...], min_duration: float) -> None:
        self._names, self._min_duration = names, min_duration
        self._model: GravityModel | None = None
        self._before: GravityModel | None = None
        self._required = self._predicted = 0
        self._errors: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=WINDOW)
        self.forget()

    def use(self, model: GravityModel, before: GravityModel | None, learned: int) -> None:
        """
        Watch another model.

        :param before: the last model of the previous payload, None if there is none.
        :param learned: number of training samples; a model from a file (0) counts as confirmed.
        """
        self._model, self._before = model, before
        self._noise = expected_residual(model)
        self._required, self._predicted = min(learned, MAX_REQUIRED), 0
        self._errors.clear()
        self.forget()

    @property
    def is_confirmed(self) -> bool:
        return self._predicted >= self._required

    def restart(self) -> None:
        """Drop the window of a payload test: the clock or the payload has changed."""
        capacity = max(MAX_WINDOW, math.ceil(
            _RELATIVE_LENGTHS[0] * (self._min_duration / PERIOD + 1.0)))
        self._rows: deque[_Row] = deque(maxlen=capacity)
        self._wait = 0
        self._due: list[int] = []
        self._tests = 0
        # Duration of the tested window, s.
        self._duration = 0.0

    def forget(self) -> None:
        """Drop the window and the findings."""
        self.restart()
        self.suspicion: PayloadResult | None = None
        # Evidence of a change of the effort that no payload explains; empty if there is none.
        self.other = ''

    def offer(self, reading: CompleteReading, qdd: FloatArray | None, gravity: FloatArray,
              residual: FloatArray) -> None:
        """
        Add a slow sample at a pose within the trained range.

        :param qdd: acceleration (N,) in rad/s^2; without one it is not tested for a payload.
        :param gravity: torque of the model in use, `residual` that without nuisance terms,
            (N,) in N·m.
        """
        if self._model is None:
            return
        error = np.abs(residual) / self._noise
        if not self.is_confirmed and float(error.max()) < GOOD:
            self._predicted += 1
        if self._before is not None:
            old = np.abs(gravity + residual - self._before.predict_one(reading.q)) / self._noise
            self._errors.append((error, old))
        if qdd is not None:
            self._add(_Row(reading, qdd, residual / residual_noise(self._model)))

    def _add(self, row: _Row) -> None:
        """Add a sample to the window of a payload test."""
        rows, last = self._rows, self._rows[-1].reading if self._rows else None
        if float(np.abs(row.qdd).max()) >= MAX_ACCELERATION or last is not None and (
                row.reading.t < last.t + 0.9 * PERIOD
                or float(np.abs(row.reading.q - last.q).max()) < _MIN_MOTION):
            return
        rows.append(row)
        self._wait = max(0, self._wait - 1)
        self._due = self._due_lengths()
        if (self.suspicion is not None or self.other) and len(rows) >= MIN_WINDOW:
            recent = np.array([row.ratio for row in list(rows)[-MIN_WINDOW:]])
            if np.sqrt((recent ** 2).mean(axis=0)).max() < _NORMAL:
                self.suspicion, self.other = None, ''

    def model_checks(self) -> list[Check]:
        """Return the checks of an unconfirmed model; a rollback is due where both fail."""
        if self.is_confirmed or len(self._errors) < WINDOW:
            return []
        new, old = (float(np.sqrt(np.square(errors).mean(axis=0)).max())
                    for errors in zip(*self._errors))
        return [
            Check(checks.PREDICTS, new, BAD, text=(
                f'the residual of the model in use is {new:.0f} times its noise over {WINDOW} '
                f'new samples, that of the previous model {old:.0f} times')),
            Check(checks.BETTER_THAN_PREVIOUS, old, max(MAX_RATIO * new, GOOD), True)]

    def is_due(self) -> bool:
        """Return whether a full test of the samples is due."""
        return self.suspicion is None and self._wait == 0 and bool(self._due)

    def window(self) -> JointSamples:
        """Return the samples to test; the next window has new samples and another length."""
        self._wait = _NEW_SAMPLES
        length = self._due[self._tests % len(self._due)]
        self._tests += 1
        rows = list(self._rows)[-length:]
        self._duration = rows[-1].reading.t - rows[0].reading.t
        picked = np.unique(
            np.linspace(0, length - 1, min(length, MAX_WINDOW)).round().astype(int))
        t, q, qd, tau, qdd = (np.array(column) for column in zip(
            *((row.reading.t, row.reading.q, row.reading.qd, row.reading.tau, row.qdd)
              for row in (rows[k] for k in picked))))
        return JointSamples.single_run(self._names, t, q, qd, tau, 'live', qdd=qdd)

    def lasts(self) -> Check:
        """Return the check of the duration of the tested window, s."""
        return Check(checks.LASTS, self._duration, self._min_duration, True,
                     'the change has not lasted long enough')

    def add_finding(self, finding: PayloadResult) -> bool:
        """Record a finding; return whether it is a new suspicion that has lasted long enough."""
        self.other = finding.text if finding.is_other else ''
        if not finding.is_payload or self.suspicion is not None or not self.lasts().passed:
            return False
        self.suspicion = finding
        return True

    def _due_lengths(self) -> list[int]:
        """Return the lengths of windows with a large residual in each part, longest first."""
        rows = list(self._rows)
        if len(rows) < MIN_WINDOW:
            return []
        large = np.abs([row.ratio for row in rows]).max(axis=1) > _LARGE
        if not large[-1]:
            return []
        enough = next((length for length in range(MIN_WINDOW, len(rows) + 1)
                       if large[-length]
                       and rows[-1].reading.t - rows[-length].reading.t >= self._min_duration),
                      None)
        lengths = {min(len(rows), MAX_WINDOW), MIN_WINDOW}
        if enough is not None:
            lengths |= {length for length in
                        (math.ceil(factor * enough) for factor in _RELATIVE_LENGTHS)
                        if length <= len(rows)}
        return [length for length in sorted(lengths, reverse=True)
                if all(part.mean() >= _MIN_SHARE
                       for part in np.array_split(large[-length:], PARTS))]
