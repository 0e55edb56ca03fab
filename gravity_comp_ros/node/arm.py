"""One arm in the node: its description, model in use, samples, and feed-forward."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from xml.etree.ElementTree import Element

from gravity_comp_ros.data.gate import Gate, GateOptions, RATE
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.description.robot_tree import parse_tree, TreeJoint
from gravity_comp_ros.errors import GravityCompError, ModelMismatchError, OptionError
from gravity_comp_ros.evaluation.expected_residual import rms
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node.epoch import DelayedSamples, Epoch, SlowSample
from gravity_comp_ros.node.feedforward import FeedForward
from gravity_comp_ros.node.messages import CompleteReading, JointStateReader, Reading
from gravity_comp_ros.node.model_in_use import ModelInUse
from gravity_comp_ros.node.options import NODE
from gravity_comp_ros.node.parameters import BY_NAME, Parameters
from gravity_comp_ros.node.watch import Watch
import numpy as np

SOURCE = 'robot_description'
NO_LIMITS = 'no torque is published without limits: set max_torque, or unlimited_torque'


@dataclass(frozen=True)
class ArmDescription:
    """
    The description of the joints of an arm.

    `geometry` is None where the joints do not form a serial chain in their order; `problem` then
    gives the reason. `max_effort` has one value per joint in N·m, or is empty. `is_other` is true
    if it names none of the joints.
    """

    geometry: Geometry | None = None
    continuous: tuple[str, ...] = ()
    max_effort: tuple[float, ...] = ()
    problem: str = ''
    is_other: bool = False


@dataclass
class Kept:
    """
    What stays through a cleanup of the node, and where an arm replaces a gripper.

    Whether torque is allowed, and the torque in N·m by joint that controllers have kept.
    """

    is_allowed: bool = True
    torque: Mapping[str, float] = field(default_factory=dict)


def describe_arm(text: str, joints: tuple[str, ...]) -> ArmDescription:
    """Return the description of these joints in a URDF; errors go to `problem`."""
    continuous: tuple[str, ...] = ()
    limits: tuple[float, ...] = ()
    known: Mapping[str, TreeJoint] = {}
    try:
        known = parse_tree(text, SOURCE).joints
        continuous = tuple(name for name in joints
                           if name in known and known[name].kind == 'continuous')
        limits = tuple(_effort(known[name].element) if name in known else 0.0 for name in joints)
        # A larger number means that there is no limit.
        if not all(0.0 < limit <= BY_NAME['max_torque'].high for limit in limits):
            limits = ()
        geometry = described_arm(text, joints, SOURCE).geometry
        if geometry.joints != joints:
            raise ModelMismatchError(
                f'the order of the joints in {SOURCE} is {", ".join(geometry.joints)}: set the '
                'parameter joints to this order to use the axes')
    except GravityCompError as problem:
        return ArmDescription(None, continuous, limits, str(problem),
                              known.keys().isdisjoint(joints))
    return ArmDescription(geometry, continuous, limits)


def _effort(element: Element) -> float:
    """Return the effort limit of a joint, 0 if it has none."""
    limit = next((part for part in element if part.tag.endswith('limit')), Element('limit'))
    with suppress(ValueError):
        return float(limit.get('effort', '0'))
    return 0.0


class Arm:
    """
    The state that exists once the joint names are known.

    :param model: the model of the present payload, from a file; None to learn one.
    """

    def __init__(self, joints: tuple[str, ...], settings: Parameters, kept: Kept,
                 model: GravityModel | None = None) -> None:
        self.joints = joints
        self.reader = JointStateReader(joints, settings.effort_scale, settings.continuous_joints,
                                       settings.max_age)
        self.described = ArmDescription()
        self.kept = kept
        self.gate_counts: Counter[str] = Counter()
        # The torque that was published before the newest messages; NaN for none.
        self._sent = np.full(len(joints), np.nan)
        self.delayed = DelayedSamples()
        self.feed = FeedForward(len(joints), settings)
        self.feed.last = np.array([kept.torque.get(name, 0.0) for name in joints])
        self.epoch = Epoch(0, joints, settings, model, is_open=model is None)
        self.watch = Watch(settings.suspect_after)
        self.learn_from = 0.0
        self.last_seen: float | None = None
        self.pose: FloatArray | None = None
        self.in_use: ModelInUse | None = None
        # Residuals since the last report (2, N) in N·m: with and without nuisance terms.
        self._residuals: list[FloatArray] = []
        self.set(settings)
        self.restart()
        if model is not None:
            self.use(model, None, 0)

    def describe(self, described: ArmDescription) -> None:
        """
        Use axes, continuous joints and effort limits of a robot description.

        Torque that is published without limits already is not limited from a topic: it would step.
        """
        if self.limit_source == 'unlimited' and self.feed.is_publishing:
            described = replace(described, max_effort=())
        self.described = described
        self.reader.allow_continuous(described.continuous)
        self._limit()

    def enable(self, enabled: bool) -> tuple[bool, str]:
        """
        Allow or forbid torque, which ramps either way; return success and a sentence.

        A refusal changes nothing: limits that arrive later start no torque.
        """
        if enabled and self.limit_source == 'none':
            return False, NO_LIMITS
        self.kept.is_allowed = enabled
        self._limit()
        if self.in_use is None:
            return True, ('no model yet; torque ramps up once there is one' if enabled else
                          'no model yet; once there is one, no torque is published')
        where = 'up' if enabled else 'down to zero'
        end = '' if enabled else ', then nothing is published'
        return True, f'torque ramps {where} over {self.settings.ramp_time} s{end}'

    @property
    def outside(self) -> FloatArray:
        """Distance (N,) in rad of the last pose from the trained range."""
        if self.in_use is None or self.pose is None:
            return np.zeros(len(self.joints))
        return self.in_use.model.coverage.distance(self.pose)

    @property
    def limit_source(self) -> str:
        """The source of the torque limits; with `none` no torque is published."""
        return self._source_with(self.settings)

    def _source_with(self, settings: Parameters) -> str:
        if settings.max_torque:
            return 'set'
        if self.described.max_effort:
            return SOURCE
        return 'unlimited' if settings.unlimited_torque else 'none'

    def check(self, settings: Parameters) -> None:
        """
        Check other settings.

        :raises OptionError: if they contradict the joints, or would end torque that is published.
        """
        settings.check(self.joints)
        if self._source_with(settings) == 'none' and self.feed.is_publishing:
            raise OptionError('without torque limits the published torque would fall to zero: '
                              'call ~/enable with false first')

    def _limit(self) -> None:
        settings, source = self.settings, self.limit_source
        if source == SOURCE:
            settings = replace(settings, max_torque=self.described.max_effort)
        self.feed.set_options(settings)
        self.feed.enabled = self.kept.is_allowed and source != 'none'

    def set(self, settings: Parameters) -> None:
        """Use other settings from now on."""
        self.settings = self.epoch.settings = settings
        self.gate = Gate(len(self.joints), GateOptions(settings.max_speed))
        self.reader.max_age = settings.max_age
        self._limit()

    def restart(self) -> None:
        """Forget earlier messages: the clock has started again."""
        # The pose of the last sample that counts.
        self._sampled = np.full(len(self.joints), np.nan)
        self.gate.reset()
        self.delayed.restart()
        self.watch.restart()

    def deactivate(self) -> None:
        """
        Forget messages: nothing is received or published from now on.

        A controller keeps the torque published last, from which the next activation goes on.
        """
        self.restart()
        self.feed.restart()

    def use(self, model: GravityModel, before: GravityModel | None, learned: int) -> None:
        """
        Take another model into use.

        :param before: the model to roll back to if this one is wrong.
        :param learned: the number of its training samples; 0 for a model from a file.
        """
        self.watch.use(model, before, learned)
        self.in_use = in_use = ModelInUse(model)
        self.feed.use(in_use.static, model.coverage, in_use.reach)
        self.reader.trained = model.coverage

    def torque(self, now: float, reading: Reading) -> FloatArray | None:
        """Return the feed-forward (N,) in N·m for a reading, None for nothing."""
        self.last_seen, self.pose = now, reading.q
        self._sent = np.where(self.feed.is_publishing, self.feed.last, np.nan)
        return self.feed.update(now, reading.q)

    def learn(self, reading: Reading, now: float) -> None:
        """
        Learn from a reading, and compare the model in use with it.

        Nothing is learned before `settle_time` has passed since the payload changed.
        """
        if reading.new_run:
            self.restart()
        if self.learn_from - now > self.settings.settle_time + 0.1:
            # The clock was set back; learning does not wait until it has caught up.
            self.learn_from = now
        if not isinstance(reading, CompleteReading) or now < self.learn_from:
            return
        reason = self.gate.offer(reading.t, reading.qd)
        self.delayed.add(reading, self._sent, reason is None)
        if reason not in (None, RATE):
            self.gate_counts[reason] += 1
        for sample in self.delayed.due(reading.t):
            # Of an arm at rest one sample counts: friction holds any part of its torque.
            has_moved = not float(
                np.abs(sample.reading.q - self._sampled).max()) < NODE.min_motion
            if has_moved:
                self._sampled = sample.reading.q
                self.epoch.offer(sample)
            if self.in_use is not None:
                self._compare(self.in_use, sample, has_moved)

    def _compare(self, in_use: ModelInUse, sample: SlowSample, has_moved: bool) -> None:
        """Record the residual of a slow sample for diagnostics, and after motion for the watch."""
        reading = sample.reading
        gravity = in_use.model.predict_one(reading.q)
        error, residual = in_use.residual(reading, gravity, sample.qdd)
        self._residuals.append(np.array((error, residual)))
        if has_moved and (
                not in_use.model.coverage.distance(reading.q).any()):
            self.watch.offer(sample, gravity, residual)

    def take_residual(self) -> FloatArray | None:
        """
        Return the RMS residuals (2, N) in N·m since the last call, None without samples.

        They are with and without nuisance terms.
        """
        residuals, self._residuals = self._residuals, []
        return rms(np.array(residuals)) if residuals else None

    def new_epoch(self, number: int, now: float, base: GravityModel | None) -> None:
        """Drop all samples; collect again after `settle_time`, when old messages have passed."""
        self.learn_from = now + self.settings.settle_time
        self.epoch = Epoch(number, self.joints, self.settings, base)
        self.restart()
        self._residuals = []
