"""Core of the node without ROS: messages and time in; torques, replies and statuses out."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.joint_order import joint_order
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.node import diagnostics
from gravity_comp_ros.node.arm import Arm, describe_arm, Kept
from gravity_comp_ros.node.learner import Events, Learner
from gravity_comp_ros.node.messages import Reading
from gravity_comp_ros.node.model_history import ModelHistory
from gravity_comp_ros.node.options import NODE
from gravity_comp_ros.node.parameters import MAX_JOINTS, Parameters
from gravity_comp_ros.worker.worker_process import command, Worker

# Difference of the times of arrival of two messages that were taken at once, s.
_ORDER = 1e-6


class NodeCore:
    """
    Reads joint states, learns, and computes the torque to publish.

    :param kept: what stays from the core before this one.
    :raises OptionError: if the settings contradict each other.
    """

    def __init__(self, settings: Parameters, topic: str, now: float,
                 kept: Kept | None = None) -> None:
        self.settings, self._kept = settings, kept or Kept(settings.enabled)
        # Messages that a newer one replaced before they were answered, since the last report.
        self._replaced = 0
        self._topic = topic
        self.events = Events()
        self.models = ModelHistory(settings.model_file)
        self.fits = Worker(command('gravity_comp_ros.node.jobs:fitting', NODE.niceness))
        self.learner: Learner | None = None
        # The last robot descriptions, and that of the arm.
        self._offered, self._description = deque[str](maxlen=NODE.depth), ''
        # Whether the joint names are those of the first message, which may be of a gripper.
        self._guessed = False
        # Messages that name no arm, and the reason.
        self._unusable, self._no_arm = 0, ''
        self.models.load(settings.joints, now)
        model = self.models.model
        if names := settings.joints or (() if model is None else model.joints):
            self._begin(names)

    @property
    def arm(self) -> Arm | None:
        """The arm, None before its joints are known."""
        return None if self.learner is None else self.learner.arm

    def set(self, settings: Parameters) -> None:
        """Use changed settings from now on; they have been checked."""
        self.settings = settings
        if self.arm is not None:
            self.arm.set(self.settings)

    def _begin(self, joints: tuple[str, ...]) -> None:
        self.settings.check(joints)
        arm = Arm(joints, self.settings, self._kept, self.models.model)
        entry = self.models.entry
        self.learner = Learner(arm, self.models, self.fits, self.events)
        self.events.log.append((
            False, f'arm of {len(joints)} joints: {", ".join(joints)}; model: '
            f'{entry.describe() if entry else "none yet"}; formulation of fits: '
            f'{self.settings.formulation}; torque limits: '
            f'{self.settings.max_torque or "none set"}'))
        self._use_description()

    def describe(self, text: str) -> None:
        """
        Use a robot description of the arm until the node is configured again.

        A later one must not change the torque limits of an arm that is being supported.
        """
        if text in self._offered:
            return
        self._offered.append(text)
        if not self._description:
            self._use_description()
        else:
            self.events.log.append((
                True, 'another robot description was received and is not used; configure the node '
                'again to use it'))

    def _use_description(self) -> None:
        """Use the first description of the arm; another device may have one on the topic, too."""
        arm, self._description = self.arm, ''
        if arm is None or not self._offered:
            return
        for text in self._offered:
            described = describe_arm(text, arm.joints)
            if not described.is_other:
                self._description = text
                break
        arm.describe(described)
        described = arm.described
        axes = f'not used: {described.problem}' if described.geometry is None else 'used'
        limits = ', '.join(f'{limit:g}' for limit in described.max_effort) or 'none'
        self.events.log.append((
            bool(described.problem), f'robot description: axes {axes}; effort limits {limits} '
            f'N·m; continuous joints: {", ".join(described.continuous) or "none"}'))

    def read_all(self, messages: Sequence[Any], arrival: float) -> list[tuple[Any, Reading]]:
        """
        Read waiting messages; return those that can be used, with their readings.

        The newest is answered by `Arm.torque`; then all are learned from (`Arm.learn`). Readings
        before a message that begins an arm with more joints are of another device.
        """
        read: list[tuple[Any, Reading]] = []
        for k, message in enumerate(messages):
            arm = self.arm
            # Messages without a stamp stay in order, so that the newest is answered.
            reading = self.read(message, arrival + _ORDER * k)
            if self.arm is not arm:
                read.clear()
            if reading is not None:
                read.append((message, reading))
        self._replaced += max(0, len(read) - 1)
        return read

    def read(self, message: Any, arrival: float) -> Reading | None:
        """
        Read a `sensor_msgs/JointState`; return None if it cannot be used.

        :param arrival: time of arrival in s on the clock of the stamps.
        """
        learner, names = self.learner, tuple(message.name)
        # Before the first fit a device with more joints replaces one whose names were guessed.
        if learner is None or (
                self._guessed and not learner.has_started and len(set(names)) == len(names)
                and len(learner.arm.joints) < len(names) <= MAX_JOINTS):
            try:
                self._begin_with_message(names)
                self._no_arm = ''
            except OptionError as problem:
                self._no_arm = str(problem)
                self._unusable += 1
        return None if self.arm is None else self.arm.reader.read(message, arrival)

    def _begin_with_message(self, names: tuple[str, ...]) -> None:
        """
        Use the joint names of a message; warn if they are not ordered from the base outwards.

        :raises OptionError: if they name no arm.
        """
        if not names or len(set(names)) != len(names):
            raise OptionError(f'the first message on {self._topic} has '
                              f'{"repeated" if names else "no"} joint names; set the parameter '
                              'joints')
        if len(names) > MAX_JOINTS:
            raise OptionError(f'{self._topic} has {len(names)} joints and the node takes at most '
                              f'{MAX_JOINTS}; set the parameter joints')
        self._begin(names)
        self._guessed = True
        order = joint_order(names, self._description or None)
        if order.joints != names:
            self.events.log.append((
                True, f'the order of the joints in the messages is {", ".join(names)}; from the '
                f'base outwards it is {", ".join(order.joints)} ({order.source}): set the '
                'parameter joints to that order, or no chain explains this arm'))

    def tick(self, now: float, wall: float | None = None) -> FloatArray | None:
        """
        Handle fits, calls and the watchdog; return the torque to publish without input.

        :param wall: wall-clock time in s for timeouts of fits and calls, where `now` is
            simulated time, which pauses and jumps.
        """
        if self.learner is None:
            return None
        self.learner.poll(now, now if wall is None else wall)
        return self.learner.arm.feed.watch(now)

    def close(self) -> None:
        """End the fit process, reply to pending calls, and finish pending saves."""
        if self.learner is not None:
            self.learner.close()
            arm = self.learner.arm
            self._kept.torque = dict(zip(arm.joints, arm.feed.last.tolist()))
        self.fits.rest()
        self.models.close()

    def statuses(self, now: float) -> list[diagnostics.Status]:
        """Return the statuses for /diagnostics, and restart their counts."""
        arm, (replaced, self._replaced) = self.arm, (self._replaced, 0)
        statuses = [diagnostics.input_status(self._topic, arm, now, replaced, self._unusable),
                    diagnostics.model_status(self.models, now, self._no_arm)]
        if self.learner is None or arm is None:
            return statuses
        return [*statuses, diagnostics.learning_status(self.learner),
                diagnostics.payload_status(arm.watch),
                diagnostics.feedforward_status(arm, now), *diagnostics.joint_statuses(arm)]
