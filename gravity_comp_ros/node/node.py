"""ROS node: topics, services, timers and life cycle of `NodeCore`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
import time
import traceback
from typing import Any

from gravity_comp_ros.evaluation.external_torque import ExternalTorqueOptions
from gravity_comp_ros.node.arm import Arm, Kept
from gravity_comp_ros.node.checks import DIAGNOSIS, ERROR, FIT, OK, STALE, WARN
from gravity_comp_ros.node.declare import DeclaredParameters, unknown_parameter_warnings
from gravity_comp_ros.node.diagnostics import Status
from gravity_comp_ros.node.learner import Learner
from gravity_comp_ros.node.messages import CompleteReading, Reading
from gravity_comp_ros.node.model_history import Reply
from gravity_comp_ros.node.model_in_use import std_of
from gravity_comp_ros.node.node_core import NodeCore
from gravity_comp_ros.node.options import NODE
from gravity_comp_ros.node.outputs import LATCHED, Outputs
import numpy as np
import rclpy
from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

# Best effort matches every publisher. Only the newest message is answered.
INPUT_QOS = QoSProfile(depth=NODE.messages, reliability=ReliabilityPolicy.BEST_EFFORT)
SERVICE_QOS = QoSProfile(depth=NODE.calls)
EXTERNAL_TORQUE = ('external_torque', 'external_torque_std', 'external_torque_significant')
NO_CLOCK = ('use_sim_time is set and /clock is not received: nothing is learned or published; '
            'start the simulation, or set use_sim_time to false')
UNCONFIGURED = 'the node is not configured: configure and activate it first'
NO_JOINTS = 'no joint states yet: check the topic and the driver'
FORBIDDEN = 'no torque will be published until ~/enable is called with true'
# Starts the action of a request; the reply is given once, now or later.
Action = Callable[[Learner, Any, Reply], None]


def _changed_if_possible(change: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
    """Reply to a request for a transition: without success if it does not exist."""
    try:
        return change(request, response)
    except rclpy_implementation.RCLError:
        response.success = False
        return response


class InputGroup(CallbackGroup):
    """Callback group of the input, which rclpy's own executor code must not execute."""

    def can_execute(self, entity: Any) -> bool:
        """Return False: only `run.InputFirstExecutor` executes the input."""
        return False


class GravityCompNode(LifecycleNode):
    """The lifecycle node `gravity_comp`; docs/node.md describes its interface."""

    def __init__(self) -> None:
        super().__init__('gravity_comp')
        self._core: NodeCore | None = None
        self.settings = DeclaredParameters(self, lambda: self._core)
        self._outputs: Outputs | None = None
        self.subscription: Subscription | None = None
        self._description: Subscription | None = None
        # Last logged level of each status.
        self._levels: dict[str, int] = {}
        self._active = False
        self._kept = Kept(self.settings.values.enabled)
        self._clock_is_simulated = False
        self._input = InputGroup()
        self._create_services()
        # rclpy raises an error where a transition does not exist in the present state.
        change = self._service_change_state.callback
        self._service_change_state.callback = partial(_changed_if_possible, change)
        # Timers use steady time, so that the watchdog runs while a simulation pauses.
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        for period, callback in ((NODE.watch_period, self._on_tick),
                                 (ExternalTorqueOptions().std_period, self._on_extrapolation),
                                 (1.0 / self.settings.values.diagnostics_rate, self._on_report)):
            self.create_timer(period, callback, clock=self._steady)
        for text in unknown_parameter_warnings(self):
            self.get_logger().warning(text)

    def _create_services(self) -> None:
        """Create the services for the life of the node, so that a call is always answered."""
        actions: dict[str, Action] = {
            'payload_changed': lambda learner, _, reply: reply(
                *learner.payload_changed(self.now())),
            'rollback': lambda learner, _, reply: reply(*learner.roll_back(self.now())),
            'enable': lambda learner, request, reply: reply(*learner.arm.enable(request.data)),
            'refit': lambda learner, _, reply: learner.request(FIT, time.monotonic(), reply),
            'diagnose': lambda learner, _, reply: learner.request(
                DIAGNOSIS, time.monotonic(), reply),
            'save_model': lambda learner, _, reply: learner.models.save(reply)}
        # Fits and disks are slow: these reply later, while joint states are handled.
        group = ReentrantCallbackGroup()
        for name, action in actions.items():
            self.create_service(SetBool if name == 'enable' else Trigger, f'~/{name}',
                                partial(self._respond, action), qos_profile=SERVICE_QOS,
                                callback_group=group)

    async def _respond(self, action: Action, request: Any, response: Any) -> Any:
        """Reply to a request, and log the reply."""
        future, core = Future(executor=self.executor), self._core

        def reply(success: bool, text: str) -> None:
            if not future.done():
                future.set_result((success, text))

        if core is None or core.learner is None:
            # Torque can be forbidden in every state.
            if forbids := isinstance(request, SetBool.Request) and not request.data:
                self._kept.is_allowed = False
            reply(forbids, FORBIDDEN if forbids else UNCONFIGURED if core is None else NO_JOINTS)
        else:
            action(core.learner, request, reply)
        response.success, response.message = await future
        if core is not None and not self._active:
            response.message = f'the node is inactive; {response.message}'
        # Throttled, because the caller has the reply.
        if response.success:
            self.get_logger().info(response.message, throttle_duration_sec=0.1)
        else:
            self.get_logger().warning(response.message, throttle_duration_sec=0.1)
        return response

    def now(self) -> float:
        """Return the time for ramps and watchdog in s: simulated if in use, else monotonic."""
        if self._clock_is_simulated:
            return float(self.get_clock().now().nanoseconds) * 1e-9
        return time.monotonic()

    def _has_time(self) -> bool:
        """Return whether there is a clock; simulated time is 0 before the first /clock."""
        return not self._clock_is_simulated or self.get_clock().now().nanoseconds > 0

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the model file, create topics, and start the process of the fits."""
        try:
            self._configure()
        except Exception as problem:
            # rclpy reports no error of a transition.
            self.close()
            self.get_logger().error(f'not configured: {type(problem).__name__}: {problem}')
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def _configure(self) -> None:
        # Not at run time: without /clock the watchdog would stand still, and the torque with it.
        self._clock_is_simulated = bool(self.get_parameter('use_sim_time').value)
        topic = self.resolve_topic_name('joint_states')
        self._core = NodeCore(self.settings.values, topic, self.now(), self._kept)
        self._core.fits.prepare()
        if self._core.models.load_problem:
            self.get_logger().error(self._core.models.load_problem)
        self._use_description(self._core)
        self._outputs = Outputs(self, self.settings.values)
        self.subscription = self.create_subscription(
            JointState, 'joint_states', lambda message: self.on_joint_states([message]), INPUT_QOS,
            callback_group=self._input)

    def _use_description(self, core: NodeCore) -> None:
        text = self.settings.values.robot_description
        if text == 'auto':
            self._description = self.create_subscription(
                String, 'robot_description', lambda message: core.describe(message.data), LATCHED)
        elif text != 'off':
            core.describe(text)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start to receive and to publish."""
        self._active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop receiving and publishing; keep the model and the samples."""
        self._active = False
        if self._core is not None and self._core.arm is not None:
            self._core.arm.deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release all resources, also after an error in a transition; models are lost."""
        self.close()
        return TransitionCallbackReturn.SUCCESS

    on_shutdown = on_error = on_cleanup

    def close(self) -> None:
        """End the fit process, and destroy topics."""
        self._active = False
        if self._core is not None:
            self._core.close()
        for subscription in (self.subscription, self._description):
            if subscription is not None:
                self.destroy_subscription(subscription)
        if self._outputs is not None:
            self._outputs.destroy()
        self._core = self._outputs = self.subscription = self._description = None

    def end_torque(self, problem: Exception) -> None:
        """
        Bring the published torque to zero, as on stale input, and report an error of the loop.

        The controller keeps the last torque that it received, so the process must not simply end.
        What has failed may fail again: first the torque falls, and no report can prevent it.
        """
        # No callback reads /clock any more, so simulated time would stand still.
        self._clock_is_simulated = False
        core, outputs = self._core, self._outputs
        if self._active and outputs is not None and core is not None and core.arm is not None:
            core.arm.feed.fail()
            while rclpy.ok() and (tau := core.arm.feed.watch(self.now())) is not None:
                with suppress(Exception):
                    outputs.torque(self.get_clock().now().to_msg(), tau)
                time.sleep(NODE.watch_period)
        self.report(problem)

    def report(self, problem: Exception) -> None:
        """Log an error in a callback, and publish it on /diagnostics."""
        text = f'error in a callback, please report it: {type(problem).__name__}: {problem}'
        with suppress(Exception):
            self.get_logger().fatal(
                f'{text}\n{"".join(traceback.format_exception(problem))}')
        with suppress(Exception):
            if self._outputs is not None:
                self._outputs.diagnostics([Status('node', ERROR, text)])

    def on_joint_states(self, messages: Sequence[JointState]) -> None:
        """Publish the torque of the newest of all waiting messages, and learn from each."""
        core, outputs = self._core, self._outputs
        if not self._active or core is None or outputs is None or not self._has_time():
            return
        now, arrival = self.now(), self.get_clock().now().nanoseconds * 1e-9
        read, arm = core.read_all(messages, arrival), core.arm
        if not read or arm is None:
            return
        tau = arm.torque(now, read[-1][1])
        outputs.name_joints(arm.joints)
        if tau is not None:
            outputs.torque(read[-1][0].header.stamp, tau)
        self._publish_model_outputs(arm, outputs, read)
        for _, reading in read:
            arm.learn(reading, now)

    def _publish_model_outputs(self, arm: Arm, outputs: Outputs,
                               read: Sequence[tuple[JointState, Reading]]) -> None:
        """Publish prediction and residual of the newest reading, and the external torque."""
        stamp, newest = read[-1][0].header.stamp, read[-1][1]
        if (in_use := arm.in_use) is None:
            return
        if outputs.is_read('prediction', 'residual'):
            predicted = in_use.predicted(newest)
            outputs.joints('prediction', stamp, newest.q, predicted)
            if newest.tau is not None:
                outputs.joints('residual', stamp, newest.q, newest.tau - predicted)
        if not outputs.is_read(*EXTERNAL_TORQUE):
            return
        for message, reading in read:
            if isinstance(reading, CompleteReading) and (
                    external := in_use.external_torque(reading)) is not None:
                significant = np.where(external.significant, external.torque, 0.0)
                for topic, values in zip(EXTERNAL_TORQUE,
                                         (external.torque, external.std, significant)):
                    outputs.joints(topic, message.header.stamp, reading.q, values)

    def _on_tick(self) -> None:
        core, outputs = self._core, self._outputs
        if core is None or outputs is None:
            return
        outputs.update_subscriptions()
        tau = core.tick(self.now(), time.monotonic())
        while core.events.log:
            self._log(*core.events.log.popleft())
        while core.events.checks:
            outputs.checks(core.events.checks.popleft())
        while core.events.payloads:
            outputs.payload_suspected(core.events.payloads.popleft())
        outputs.model(core.models.entry)
        if tau is not None and self._active:
            outputs.torque(self.get_clock().now().to_msg(), tau)

    def _on_extrapolation(self) -> None:
        core, outputs = self._core, self._outputs
        arm = None if core is None else core.arm
        if (self._active and outputs is not None and arm is not None and arm.in_use is not None
                and arm.pose is not None and outputs.is_read('extrapolation')):
            outputs.joints('extrapolation', self.get_clock().now().to_msg(),
                           arm.outside, std_of(arm.in_use.model, arm.pose))

    def _on_report(self) -> None:
        if self._core is not None and self._outputs is not None:
            statuses = self._core.statuses(self.now()) + self._graph_statuses()
            self._outputs.diagnostics(statuses)
            self._log_level_changes(statuses)

    def _graph_statuses(self) -> list[Status]:
        """Return the state of the ROS graph: clock, nodes of the same name, publishers."""
        statuses = [] if self._has_time() else [Status('clock', ERROR, NO_CLOCK)]
        topic = self.resolve_topic_name('joint_states')
        publishers = self.count_publishers(topic)
        nodes = self.get_node_names_and_namespaces().count((self.get_name(), self.get_namespace()))
        values = {'publishers of joint states': str(publishers), 'nodes of this name': str(nodes)}
        if nodes > 1:
            text = (f'{nodes} nodes are named {self.get_fully_qualified_name()}: all publish '
                    'torque and reply to services; end one, or give it a namespace')
            return [*statuses, Status('graph', ERROR, text, values)]
        arm = None if self._core is None else self._core.arm
        if publishers > 1 and arm is not None and arm.reader.are_out_of_order:
            text = (f'{publishers} publishers on {topic}, and messages about the joints of this '
                    'arm arrive out of order: are two drivers running?')
            return [*statuses, Status('graph', WARN, text, values)]
        return [*statuses, Status('graph', OK, f'{publishers} publishers of joint states', values)]

    def _log_level_changes(self, statuses: list[Status]) -> None:
        """Log each status whose level has changed."""
        for status in statuses:
            before = self._levels.get(status.name, OK)
            self._levels[status.name] = status.level
            if status.level == before or (status.level == STALE and before == OK
                                          and self._core is not None
                                          and self._core.arm is None):
                continue
            self._log(status.level != OK, f'{status.name}: {status.message}')

    def _log(self, is_warning: bool, text: str) -> None:
        # rclpy raises an error if one line of code logs with different severities.
        if is_warning:
            self.get_logger().warning(text)
        else:
            self.get_logger().info(text)
