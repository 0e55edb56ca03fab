"""
Watch of the model in use on new slow samples.

A new model that is worse than the previous one is rolled back. Where the payload may have changed
without a call of `~/payload_changed`, the fit process tests a window of samples.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.evaluation.expected_residual import expected_residual, residual_noise, rms
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node import checks
from gravity_comp_ros.node.checks import Check, PayloadResult
from gravity_comp_ros.node.epoch import SlowSample
from gravity_comp_ros.node.options import CHECKS, NODE
import numpy as np

LEARN = 'learn'
# Number of samples that judge a new model.
WINDOW = NODE.window // 2


class Watch:
    """
    The new samples of the model in use, and the finding in them.

    A model is confirmed once it has predicted as many new samples as it was trained on.

    :param min_duration: shortest duration in s of a window for a payload test.
    """

    def __init__(self, min_duration: float) -> None:
        self._min_duration = min_duration
        self._before: GravityModel | None = None
        self._required = self._predicted = 0
        self._errors: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=WINDOW)
        self.restart()

    def use(self, model: GravityModel, before: GravityModel | None, learned: int) -> None:
        """
        Watch another model.

        :param before: the last model of the previous payload, None if there is none.
        :param learned: number of training samples; a model from a file (0) counts as confirmed.
        """
        self._before = before
        # Noise (N,) in N·m, with and without the drift of friction.
        self._expected, self._noise = expected_residual(model), residual_noise(model)
        self._required, self._predicted = min(learned, NODE.max_required), 0
        self._errors.clear()
        self.restart()

    @property
    def is_confirmed(self) -> bool:
        return self._predicted >= self._required

    def restart(self) -> None:
        """Drop window and finding: the model, the clock or the payload has changed."""
        # The window: samples with their residual (N,) over the noise.
        self._rows: deque[tuple[SlowSample, FloatArray]] = deque()
        # New samples until the next test, and whether the window requires one.
        self._wait, self._is_large = 0, False
        # A suspected payload, or a change of the effort that no payload explains.
        self.finding: PayloadResult | None = None

    def offer(self, sample: SlowSample, gravity: FloatArray, residual: FloatArray) -> None:
        """
        Add a slow sample of the model in use, at a pose within the trained range.

        Without an acceleration it is not tested for a payload.

        :param gravity: torque of the model in use, `residual` that without nuisance terms,
            (N,) in N·m.
        """
        new, qdd = sample.reading, sample.qdd
        error = np.abs(residual) / self._expected
        if not self.is_confirmed and float(error.max()) < CHECKS.predicted:
            self._predicted += 1
        if self._before is not None:
            old = np.abs(
                gravity + residual - self._before.predict_one(new.q)) / self._expected
            self._errors.append((error, old))
        if qdd is None or float(np.abs(qdd).max()) >= NODE.max_acceleration:
            return
        rows = self._rows
        rows.append((sample, residual / self._noise))
        while len(rows) > NODE.window and new.t - rows[1][0].reading.t >= self._min_duration:
            rows.popleft()
        self._wait = max(0, self._wait - 1)
        ratio = np.array([ratio for _, ratio in rows])
        large = np.abs(ratio).max(axis=1) > CHECKS.large
        lasts = len(rows) >= NODE.window and (
            new.t - rows[0][0].reading.t >= self._min_duration)
        self._is_large = lasts and bool(large[0] and large[-1]) and all(
            part.mean() >= CHECKS.min_large for part in np.array_split(large, NODE.parts))
        if len(rows) >= NODE.window and rms(ratio[-NODE.window:]).max() < CHECKS.max_residual:
            self.finding = None

    def model_checks(self) -> list[Check]:
        """Return the checks of an unconfirmed model; a rollback is due where both fail."""
        if self.is_confirmed or len(self._errors) < WINDOW:
            return []
        new, old = (float(rms(np.array(errors)).max()) for errors in zip(*self._errors))
        return [
            Check(checks.PREDICTS, new, CHECKS.max_unpredicted, text=(
                f'the residual of the model in use is {new:.0f} times its noise over {WINDOW} '
                f'new samples, that of the previous model {old:.0f} times')),
            Check(checks.BETTER_THAN_PREVIOUS, old,
                  max(CHECKS.max_previous * new, CHECKS.predicted), True)]

    def is_due(self) -> bool:
        """Return whether a full test of the samples is due."""
        is_suspected = self.finding is not None and self.finding.is_payload
        return not is_suspected and self._wait == 0 and self._is_large

    def window(self) -> list[SlowSample]:
        """Return the samples to test, all with accelerations; the next window has new samples."""
        self._wait, last = NODE.block, len(self._rows) - 1
        picked = np.linspace(0, last, min(last + 1, NODE.max_window)).round().astype(int)
        return [replace(self._rows[k][0], is_resolved=True) for k in picked]

    def add_finding(self, found: PayloadResult) -> bool:
        """Record a finding; return whether it is a suspicion."""
        self.finding = found if found.is_payload or found.is_other else None
        return found.is_payload
