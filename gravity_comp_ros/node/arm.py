"""State of one arm in the node: model in use, samples, feed-forward, figures of diagnostics."""

from __future__ import annotations

from collections import Counter
from dataclasses import fields, replace

from gravity_comp_ros.data.gate import Gate, GateOptions, RATE
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node import diagnostics
from gravity_comp_ros.node.arm_description import ArmDescription, SOURCE
from gravity_comp_ros.node.checks import Check
from gravity_comp_ros.node.epoch import Epoch, EpochOptions
from gravity_comp_ros.node.feedforward import FeedForward, FeedForwardOptions
from gravity_comp_ros.node.job_messages import PayloadLimits
from gravity_comp_ros.node.messages import (
    CompleteReading, JointStateReader, Reading, TIME_BACK, TIME_STILL)
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.node.realtime_effects import EffectsInUse
from gravity_comp_ros.node.sent_torque import SentTorqueHistory
from gravity_comp_ros.node.slow_samples import (
    DelayedSamples, expected_residual, LiveResidual, residual_noise, SlowSample)
from gravity_comp_ros.node.torque_source import TorqueSource, UncertainChange
from gravity_comp_ros.node.watch import ModelWatch, PayloadWatch
import numpy as np

# Time between two evaluations of the share of an uncertain change, s. Each takes 0.2 ms.
SHARE_PERIOD = 0.2


class Arm:
    """The state that exists once the joint names are known."""

    def __init__(self, joints: tuple[str, ...], settings: Parameters,
                 is_open: bool, has_base: bool) -> None:
        self.joints = joints
        self._settings = settings
        self.reader = JointStateReader(joints, settings.effort_scale, settings.continuous_joints,
                                       settings.max_age)
        self.described: ArmDescription | None = None
        self._allowed = settings.enabled
        self.is_interleaved = False
        self.gate = Gate(len(joints), gate_options(settings))
        self.gate_counts: Counter[str] = Counter()
        self.sent = SentTorqueHistory(len(joints))
        self.delayed = DelayedSamples()
        self.feed = FeedForward(len(joints), feedforward_options(settings))
        self.epoch = Epoch(0, joints, epoch_options(settings), is_open, has_base)
        self.payload = PayloadWatch(joints, settings.suspect_after)
        self._watch: ModelWatch | None = None
        self._residual: LiveResidual | None = None
        # Sums of squared residuals since the last report: with and without nuisance terms.
        self._squares = np.zeros((2, len(joints)))
        self.n_residual = 0
        self.learn_from = 0.0
        self.last_seen: float | None = None
        self.pose: FloatArray | None = None
        self._model: GravityModel | None = None
        self._source: TorqueSource | None = None
        self._change: UncertainChange | None = None
        self._share: FloatArray | None = None
        self._share_at = -np.inf
        self._effects = EffectsInUse(None, settings)
        self._reported: Counter[str] = Counter()
        self._reported_received = 0
        self._limit()

    def describe(self, described: ArmDescription) -> None:
        """Use axes, continuous joints and effort limits of a robot description."""
        self.described = described
        self.reader.allow_continuous(described.continuous)
        self._limit()

    def enable(self, enabled: bool) -> None:
        """Allow or forbid torque; it ramps either way."""
        self._allowed = enabled
        self._limit()

    @property
    def geometry(self) -> Geometry | None:
        """The axes of the arm where they are known."""
        return None if self.described is None else self.described.geometry

    @property
    def is_limited(self) -> bool:
        """Return whether there is a torque limit, or `unlimited_torque` is set."""
        return bool(self.feed.options.max_torque) or self._settings.unlimited_torque

    def _limit(self) -> None:
        options = feedforward_options(self._settings)
        if not options.max_torque and self.described is not None:
            options = replace(options, max_torque=self.described.max_effort)
        self.feed.set_options(options)
        self.feed.enable(self._allowed and self.is_limited)

    def _limit_source(self) -> str:
        if self._settings.max_torque:
            return 'set'
        if self.feed.options.max_torque:
            return SOURCE
        return 'unlimited' if self.is_limited else 'none'

    def set(self, settings: Parameters) -> None:
        """Use changed settings from now on."""
        self._settings = settings
        self.gate = Gate(len(self.joints), gate_options(settings))
        self.reader.max_age = settings.max_age
        self._limit()
        self.epoch.set_options(epoch_options(settings))
        self._effects = EffectsInUse(self._model, settings)
        self._feed()

    def restart(self) -> None:
        """Forget earlier messages: the clock has started again."""
        self.gate.reset()
        self.delayed.restart()
        self.payload.restart()

    def deactivate(self) -> None:
        """Forget messages and torque: nothing is received or published from now on."""
        self.restart()
        self.feed.restart()

    def use(self, model: GravityModel, before: GravityModel | None, learned: int,
            change: UncertainChange | None = None) -> None:
        """
        Take another model into use.

        :param before: the model to roll back to if this one is wrong.
        :param learned: the number of its training samples; 0 for a model from a file.
        :param change: change from the previous payload where it was learned from few samples.
        """
        self._model = model
        self._watch = ModelWatch(model, before, learned)
        self._residual = LiveResidual(model)
        self.payload.forget()
        self._effects = EffectsInUse(model, self._settings)
        self._source, self._change, self._share = TorqueSource.of(model), change, None
        if change is not None:
            share = np.zeros(len(self.joints))
            self._share = share if self.pose is None else change.share(
                self._source.nearest(self.pose))
        self._feed()

    def _feed(self) -> None:
        """Pass the torque to publish to the feed-forward."""
        if self._source is None:
            return
        source = replace(self._source, effects=self._effects.compensation())
        if self._change is not None and self._share is not None:
            source = replace(source, predict=self._change.with_share(self._share))
        self.feed.use(source)

    def torque(self, now: float, reading: Reading) -> FloatArray | None:
        """Return the feed-forward (N,) in N·m for a reading, None for nothing."""
        self.last_seen, self.pose = now, reading.q
        return self._published(now, self.feed.update(now, reading.q, reading.qd))

    def update_change_share(self, now: float) -> None:
        """Evaluate the share of an uncertain change at the present pose, every `SHARE_PERIOD`."""
        if self._change is None or self._source is None or self.pose is None or (
                0.0 <= now - self._share_at < SHARE_PERIOD):
            return
        self._share_at = now
        share = self._change.share(self._source.nearest(self.pose))
        if self._share is None or not np.array_equal(share, self._share):
            self._share = share
            self._feed()

    def watch(self, now: float) -> FloatArray | None:
        """Return the torque (N,) in N·m to publish without input, None for nothing."""
        return self._published(now, self.feed.watch(now))

    def _published(self, now: float, tau: FloatArray | None) -> FloatArray | None:
        if tau is not None:
            self.sent.published(now, tau)
        return tau

    def learn(self, reading: Reading, now: float) -> None:
        """Learn from a reading, and compare the model in use with it."""
        if reading.new_run:
            self.restart()
        if not isinstance(reading, CompleteReading) or not self._accepts_samples(now):
            return
        self.delayed.add_velocity(reading.t, reading.qd)
        reason = self.gate.offer(reading.t, reading.q, reading.qd)
        if reason is None:
            self.delayed.hold(reading, self.sent.before(now))
        elif reason != RATE:
            self.gate_counts[reason] += 1
        for sample in self.delayed.due(reading.t):
            r = sample.reading
            self.epoch.offer(r.t, r.q, r.qd, r.tau, sample.qdd, sample.sent)
            self._record_residual(sample)

    def _record_residual(self, sample: SlowSample) -> None:
        """Record the residual of a slow sample for diagnostics, model watch and payload watch."""
        reading, model = sample.reading, self._model
        if model is None or self._watch is None or self._residual is None:
            return
        q, qd, tau = reading.q, reading.qd, reading.tau
        qdd = reading.acceleration() if sample.qdd is None else sample.qdd
        gravity = model.predict_one(q)
        error, residual = self._residual.of(sample, gravity, qdd)
        self._squares += np.square([error, residual])
        self.n_residual += 1
        if self.distance(q).any():
            return
        self._watch.offer(q, gravity + residual, gravity)
        if qdd is not None:
            self.payload.offer(reading.t, q, qd, tau, qdd, residual / residual_noise(model))

    def model_checks(self) -> list[Check]:
        """Return the checks of a model that is not confirmed; a rollback is due if both fail."""
        return [] if self._watch is None else self._watch.checks()

    @property
    def is_confirmed(self) -> bool:
        """Return whether the model in use has predicted as many samples as it was trained on."""
        return self._watch is None or self._watch.is_confirmed

    def distance(self, q: FloatArray) -> FloatArray:
        """Return the distance outside the trained range (N,), rad, modulo whole revolutions."""
        if self._model is None or self._source is None:
            return np.zeros(len(self.joints))
        return self._model.coverage.distance(self._source.nearest(q))

    def predicted(self, reading: Reading) -> FloatArray | None:
        """Return the torque (N,) in N·m that the model predicts, None without a model."""
        if self._model is None:
            return None
        return self._effects.predicted(reading, self._model.predict_one(reading.q))

    def extrapolation(self) -> tuple[FloatArray, FloatArray] | None:
        """
        Return the uncertainty of the model at the present pose, None without a model or a pose.

        :return: distance outside the trained range (N,) in rad; standard deviation of the
            model's torque (N,) in N·m, empty if the model has none.
        """
        if self._model is None or self.pose is None:
            return None
        try:
            std = self._model.predict_std(self.pose)[0]
        except (DataError, np.linalg.LinAlgError):
            std = np.zeros(0)
        return self.distance(self.pose), std

    def _accepts_samples(self, now: float) -> bool:
        """Return whether `settle_time` has passed since the payload changed."""
        if self.learn_from - now > self._settings.settle_time + 0.1:
            # The clock was set back; learning does not wait until it has caught up.
            self.learn_from = now
        return now >= self.learn_from

    def new_epoch(self, now: float, has_base: bool) -> None:
        """Drop all samples; collect again after `settle_time`, when old messages have passed."""
        self.learn_from = now + self._settings.settle_time
        self.epoch = Epoch(self.epoch.number + 1, self.joints, epoch_options(self._settings),
                           has_base=has_base)
        self.delayed.restart()
        self.payload.forget()
        self._squares[:] = 0.0
        self.n_residual = 0

    def input_status(self, topic: str, now: float, late: int = 0) -> diagnostics.Status:
        """Return the state of the input since the last call; `late` as in `diagnostics`."""
        counts = self.reader.counts
        age = None if self.last_seen is None else now - self.last_seen
        received = self.reader.received - self._reported_received
        new = counts - self._reported
        self._reported, self._reported_received = counts.copy(), self.reader.received
        self.is_interleaved = new[TIME_BACK] + new[TIME_STILL] > 0
        stale = age is not None and age > self.feed.options.stale_after
        return diagnostics.input_status(topic, self.reader.received, received, age, stale, counts,
                                        new, late, self.reader.age)

    def statuses(self, now: float) -> list[diagnostics.Status]:
        """Return the state of the feed-forward and of each joint."""
        model, outside, noise = self._model, None, None
        if model is not None and self.pose is not None:
            outside = self.distance(self.pose)
        residual = np.sqrt(self._squares / self.n_residual) if self.n_residual else None
        self._squares[:] = 0.0
        self.n_residual = 0
        if model is not None:
            noise = np.array([model.noise, expected_residual(model)])
        return [
            diagnostics.feedforward_status(
                self.feed.state(now), self.feed.enabled,
                0.0 if outside is None else float(outside.max()), self._limit_source(),
                self.feed.margin, self._effects.sent, self._effects.problem),
            *diagnostics.joint_statuses(
                self.joints, self.epoch.coverage().span, residual, noise, outside,
                not self.epoch.is_open)]


def gate_options(given: Parameters) -> GateOptions:
    """Return the options of the slow-motion gate."""
    return GateOptions(given.max_speed, given.max_acceleration or None, given.sample_rate)


def epoch_options(given: Parameters) -> EpochOptions:
    """Return the sizes of an epoch."""
    return EpochOptions(given.capacity, given.min_samples, given.first_samples,
                        given.full_samples, given.min_span,
                        block=max(5, round(given.sample_rate)))


def feedforward_options(given: Parameters) -> FeedForwardOptions:
    """Return the options of the feed-forward; their names are those of the parameters."""
    return FeedForwardOptions(**{each.name: getattr(given, each.name)
                                 for each in fields(FeedForwardOptions)
                                 if hasattr(given, each.name)})


def payload_limits(given: Parameters) -> PayloadLimits:
    """Return the limits of a payload."""
    return PayloadLimits(given.max_payload, given.max_payload_reach)
