"""What the node does, free of ROS: messages and time go in, torques and sentences come out."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from typing import Any

from gravity_comp_ros.data.gate import RATE
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.joint_order import joint_order
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import GravityCompError, ModelFileError, OptionError
from gravity_comp_ros.node import diagnostics
from gravity_comp_ros.node.arm import Arm
from gravity_comp_ros.node.arm_description import describe_arm
from gravity_comp_ros.node.fit_requests import Reply
from gravity_comp_ros.node.learner import can_change, Learner
from gravity_comp_ros.node.live_friction import usual_residual
from gravity_comp_ros.node.messages import Reading, WholeReading
from gravity_comp_ros.node.model_history import Entry, Models
from gravity_comp_ros.node.parameters import MOST_JOINTS, Parameters
from gravity_comp_ros.node.realtime_effects import compensable

Answer = tuple[bool, str]

NO_JOINTS = 'no joint states yet: is the topic right, and does the driver run?'


class NodeCore:
    """
    Reads joint states, learns, and says which torque to publish.

    :param topic: the input topic, to be named in diagnostics.
    :raises OptionError: if the settings contradict each other.
    """

    def __init__(self, settings: Parameters, topic: str, now: float) -> None:
        self.settings = settings
        # How often messages came faster than they could be handled, since the start.
        self.late = self._late_reported = 0
        self._topic = topic
        # What happened, for the log: (is it bad news, sentence).
        self.news: deque[tuple[bool, str]] = deque(maxlen=100)
        self.models = Models(settings.model_file, settings.history)
        self.learner = Learner(settings, self.models, self.news)
        self.arm: Arm | None = None
        self._description = ''
        # Joints that were taken from a first message, which may be a gripper's.
        self._guessed = False
        self._unnamed: Counter[str] = Counter()
        joints = settings.joints
        try:
            entry = self.models.load(joints, now)
        except GravityCompError as problem:
            # A damaged file must not stop the node: it starts without a model and says so.
            entry, self.models.problem = None, str(problem)
        if names := joints or (entry.model.joints if entry else ()):
            self._begin(names, entry)

    def set(self, settings: Parameters) -> None:
        """Use changed settings from now on; they have been checked."""
        self.settings = self.learner.settings = settings
        self.learner.fits.timeout = settings.fit_timeout
        if self.arm is not None:
            self.arm.set(self.settings)

    def _begin(self, joints: tuple[str, ...], entry: Entry | None) -> None:
        self.settings.check(joints)
        check_effects(self.settings, joints)
        self.arm = Arm(joints, self.settings, is_open=entry is None,
                       has_base=entry is not None and can_change(entry.model))
        if entry is not None:
            self.arm.use(entry.model, None, 0)
            self.learner.begin(entry.model)
        self.news.append((False, f'arm of {len(joints)} joints: {", ".join(joints)}; model: '
                          f'{entry.describe() if entry else "none yet"}; formulation of fits: '
                          f'{self.settings.formulation}; bound of the torque: '
                          f'{self.settings.max_torque or "none set"}'))
        self._use_description()

    def describe(self, text: str) -> None:
        """Use a robot description from now on."""
        self._description = text
        self._use_description()

    def _use_description(self) -> None:
        arm = self.arm
        if arm is None or not self._description:
            return
        found = describe_arm(self._description, arm.joints)
        arm.describe(found)
        axes = f'not used: {found.problem}' if found.geometry is None else 'used'
        limits = ', '.join(f'{limit:g}' for limit in found.max_effort) or 'none'
        self.news.append((bool(found.problem), f'robot description: axes {axes}; effort limits '
                          f'{limits} N·m; joints without end: '
                          f'{", ".join(found.continuous) or "none"}'))

    def message(self, message: Any, now: float, arrival: float
                ) -> tuple[Reading | None, FloatArray | None]:
        """
        Read a `sensor_msgs/JointState`; return what it says and the torque to publish.

        `learn` is for afterwards: an answer does not wait for it.

        :param now: monotonic time in s, for ramps and the watchdog.
        :param arrival: time in s for a message without a stamp.
        """
        arm = self.arm
        if arm is None or (self._guessed and self._is_larger(arm, message.name)):
            arm = self._meet(tuple(message.name))
            if arm is None:
                return None, None
        reading = arm.reader.read(message, arrival)
        if reading is None:
            return None, None
        tau = arm.torque(now, reading)
        arm.last_seen, arm.pose = now, reading.q
        return reading, tau

    def learn(self, reading: Reading, now: float) -> None:
        """
        Learn from what `message` has read, and compare the model in use with it.

        :param now: as for `message`; what was published before is what the arm has measured.
        """
        arm = self.arm
        if arm is None:
            return
        if reading.new_run:
            arm.gate.reset()
            arm.health.restart()
            arm.payload.restart()
        if isinstance(reading, WholeReading) and arm.is_settled(now):
            self._offer(arm, reading, now)

    def _is_larger(self, arm: Arm, names: Sequence[str]) -> bool:
        """Return whether another device with more joints speaks before there is a model."""
        return (self.models.model is None and self.learner.jobs == 0 and arm.reader.joints != names
                and len(set(names)) == len(names) and len(arm.joints) < len(names) <= MOST_JOINTS)

    def _meet(self, names: tuple[str, ...]) -> Arm | None:
        """Take the joints from a first message."""
        try:
            if not names or len(set(names)) != len(names):
                raise OptionError(f'the first message on {self._topic} has '
                                  f'{"repeated" if names else "no"} joint names; set the '
                                  'parameter joints')
            if len(names) > MOST_JOINTS:
                raise OptionError(f'{self._topic} has {len(names)} joints and a model takes at '
                                  f'most {MOST_JOINTS}; set the parameter joints')
            self._begin(names, None)
            self._guessed = True
            self._ask_for_order(names)
        except OptionError as problem:
            self.models.problem = str(problem)
            self._unnamed['missing_joint'] += 1
            return None
        self.models.problem = ''
        return self.arm

    def _ask_for_order(self, names: tuple[str, ...]) -> None:
        """Warn if the joints of the messages are not ordered from the base outwards."""
        order = joint_order(names, self._description or None)
        if order.joints != names:
            self.news.append((True, f'joints are recorded as {", ".join(names)}; from the base '
                              f'outwards they are {", ".join(order.joints)} ({order.source}): '
                              'set the parameter joints, or no chain explains this arm'))

    def _offer(self, arm: Arm, reading: WholeReading, now: float) -> None:
        reason = arm.gate.offer(reading.t, reading.q, reading.qd)
        if reason is not None:
            if reason != RATE:
                arm.gate_counts[reason] += 1
            return
        predicted = arm.predicted(reading)
        model = self.models.model
        fault = arm.health.fault(reading.q, reading.tau, predicted,
                                 None if model is None else usual_residual(model))
        if fault is not None:
            arm.leave_out(fault)
            return
        arm.epoch.offer(reading.t, reading.q, reading.qd, reading.tau, arm.sent.before(now))
        if predicted is not None:
            arm.compared(reading, predicted)
            if (objection := arm.objection()) is not None:
                self.learner.roll_back_alone(arm, objection, now)

    def tick(self, now: float, wall: float | None = None) -> FloatArray | None:
        """
        Look after fits and the watchdog; return the torque to publish without input.

        :param wall: the time for fits and calls where `now` is that of a simulation, whose
            pauses and leaps are no reason to give up a fit, or to wait for one for ever.
        """
        arm = self.arm
        self.learner.poll(arm, now, now if wall is None else wall)
        if arm is None:
            return None
        arm.look_at_change(now)
        return arm.watch(now)

    def payload_changed(self, now: float) -> Answer:
        """Open a new epoch: old samples go, the model in use stays until a better one is there."""
        return (False, NO_JOINTS) if self.arm is None else \
            self.learner.payload_changed(self.arm, now)

    def rollback(self, now: float) -> Answer:
        """Bring back the last model of the payload before; no fit follows by itself."""
        return (False, NO_JOINTS) if self.arm is None else self.learner.roll_back(self.arm, now)

    def refit(self, wall: float, reply: Reply) -> None:
        """Fit what was collected; `reply` is called once, now or when the fit has ended."""
        self._want(wall, reply, is_question=False)

    def diagnose(self, wall: float, reply: Reply) -> None:
        """Ask which effect the model lacks; `reply` as for `refit`."""
        self._want(wall, reply, is_question=True)

    def _want(self, wall: float, reply: Reply, is_question: bool) -> None:
        if self.arm is None:
            reply(False, NO_JOINTS)
        else:
            self.learner.want(self.arm, wall, reply, is_question)

    def enable(self, enabled: bool) -> Answer:
        """Ramp torque up or down."""
        if self.arm is None:
            return False, NO_JOINTS
        self.arm.enable(enabled)
        if enabled and not self.arm.is_limited:
            return False, ('no torque is published without a bound: set max_torque, or '
                           'unlimited_torque')
        seconds = self.settings.ramp_time
        if enabled:
            return True, f'torque ramps up over {seconds} s'
        return True, f'torque ramps down to zero over {seconds} s, then nothing is published'

    def save(self) -> Answer:
        """Write the model file; called from another thread, for a disk may be slow."""
        try:
            return True, self.models.save()
        except ModelFileError as problem:
            return False, str(problem)

    def save_alone(self) -> None:
        """Write the model file because a new model is in use; say if that fails."""
        success, text = self.save()
        if not success:
            self.models.problem = text
        self.news.append((not success, text))

    def close(self) -> None:
        """End the fit process, and answer whoever waits."""
        self.learner.close()

    def statuses(self, now: float) -> list[diagnostics.Status]:
        """Return what to publish on /diagnostics; counts since the last call start again."""
        entry = self.models.entry
        model = diagnostics.model_status(
            entry.describe() if entry else None, max(0.0, now - entry.since) if entry else 0.0,
            self.models.n_past, self.models.problem)
        arm = self.arm
        if arm is None:
            received = sum(self._unnamed.values())
            return [diagnostics.input_status(self._topic, received, received, None, False,
                                             self._unnamed, self._unnamed), model]
        late, self._late_reported = self.late - self._late_reported, self.late
        return [arm.input_status(self._topic, now, late), model,
                diagnostics.learning_status(self.learner.status(arm)),
                diagnostics.payload_status(
                    arm.payload.suspicion.text if arm.payload.suspicion else '',
                    arm.payload.other),
                *arm.statuses(self.models.model, now)]


def check_effects(settings: Parameters, joints: tuple[str, ...]) -> None:
    """
    Check that effects are named that there are, on joints of the arm.

    :raises OptionError: if not, or if one to be compensated is not fit for that.
    """
    try:
        requests(settings.effects, joints)
    except OptionError as problem:
        raise OptionError(f'parameter effects: {problem}') from problem
    compensable(settings.compensate, joints)
