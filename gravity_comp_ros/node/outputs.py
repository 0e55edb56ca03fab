"""Publishers of the node, and its messages; those of a loop are created once and reused."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
import math

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import InertiaStamped
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.export.c_source import parameters_of
from gravity_comp_ros.export.gravity_code import Numbers
from gravity_comp_ros.export.payload_lines import Payload, payload_of
from gravity_comp_ros.node.checks import PayloadResult, WARN
from gravity_comp_ros.node.diagnostics import Status
from gravity_comp_ros.node.model_history import Entry
from gravity_comp_ros.node.options import NODE
from gravity_comp_ros.node.parameters import Parameters as Settings
import numpy as np
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String

# Late subscribers receive the last events with their stamps, and the last model.
EVENTS, LATCHED = (QoSProfile(depth=depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)
                   for depth in (NODE.depth, 1))
# Topics with one number per joint; the last one exists with a servo stiffness only.
JOINT_TOPICS = ('gravity_torques', 'prediction', 'residual', 'extrapolation', 'external_torque',
                'external_torque_std', 'external_torque_significant', 'position_offset')


def model_message(numbers: Numbers) -> Float64MultiArray:
    """
    Return the numbers of a model as a message, for a controller that runs the exported C source.

    `layout.dim[0].label` is the layout in hexadecimal, its size the number of values; the labels
    of the other dimensions, all of size 1, name the values.
    """
    count = len(numbers.labels)
    message = Float64MultiArray(data=numbers.values.tolist())
    message.layout.dim = [
        MultiArrayDimension(label=f'{numbers.layout:08x}', size=count, stride=count),
        *(MultiArrayDimension(label=label, size=1, stride=1) for label in numbers.labels)]
    return message


def payload_message(payload: Payload | None, stamp: Time) -> InertiaStamped:
    """
    Return mass and centre of mass in the frame of the payload; inertias, unknown, are 0.

    :param payload: None for an unknown one: its mass is NaN.
    """
    message = InertiaStamped()
    message.header.stamp = stamp
    if payload is None:
        message.inertia.m = math.nan
        return message
    message.header.frame_id = payload.frame
    message.inertia.m = payload.mass.value
    for axis, x in payload.centre.items():
        setattr(message.inertia.com, axis, x.value)
    return message


def position_offset(tau: FloatArray, stiffness: FloatArray, largest: float) -> FloatArray:
    """
    Return the angle (N,) in rad to add to the goals of servos for a torque (N,) in N·m.

    :param stiffness: (N,) or (1,) in N·m/rad. :param largest: limit of the angle in rad.
    """
    return np.minimum(np.maximum(tau / stiffness, -largest), largest)


class Outputs:
    """All publishers of the node, whose state enables the managed ones."""

    def __init__(self, node: LifecycleNode, settings: Settings) -> None:
        self._node = node
        self._stiffness = np.array(settings.servo_stiffness)
        self._max_offset = settings.max_position_offset
        self._messages = {topic: JointState() for topic in (
            JOINT_TOPICS if settings.servo_stiffness else JOINT_TOPICS[:-1])}
        self._command = Float64MultiArray()
        self._names: Sequence[str] = ()
        self._sent_model: Entry | None = None
        # The topics that have subscribers.
        self._read: frozenset[str] = frozenset()
        kinds = {**dict.fromkeys(self._messages, (JointState, NODE.depth)),
                 'commands': (Float64MultiArray, NODE.depth), 'checks': (String, EVENTS),
                 'payload_suspected': (DiagnosticArray, EVENTS)}
        self._managed = {topic: node.create_lifecycle_publisher(kind, f'~/{topic}', qos)
                         for topic, (kind, qos) in kinds.items()}
        # Not managed, so that an inactive node publishes diagnostics and its model.
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', NODE.depth)
        self._model = node.create_publisher(Float64MultiArray, '~/model', LATCHED)
        self._payload = node.create_publisher(InertiaStamped, '~/payload', LATCHED)

    def name_joints(self, joints: Sequence[str]) -> None:
        """Write the joint names into all messages, unless they have them."""
        if joints is self._names:
            return
        self._names = joints
        for message in self._messages.values():
            message.name = list(joints)

    def update_subscriptions(self) -> None:
        """Find which topics have subscribers; too slow to call for each message."""
        self._read = frozenset(topic for topic in self._messages
                               if self._managed[topic].get_subscription_count() > 0)

    def is_read(self, *topics: str) -> bool:
        """Return whether one of these topics of joints has a subscriber."""
        return not self._read.isdisjoint(topics)

    def joints(self, topic: str, stamp: Time, position: FloatArray | None = None,
               effort: FloatArray | None = None) -> None:
        """Publish one number per joint (N,) on a topic of `JOINT_TOPICS`."""
        message = self._messages[topic]
        message.header.stamp = stamp
        if position is not None:
            message.position = array('d', position.tobytes())
        if effort is not None:
            message.effort = array('d', effort.tobytes())
        self._managed[topic].publish(message)

    def torque(self, stamp: Time, tau: FloatArray) -> None:
        """Publish the feed-forward (N,) in N·m, as command, joint state and position offset."""
        self._command.data = array('d', tau.tobytes())
        self._managed['commands'].publish(self._command)
        self.joints('gravity_torques', stamp, effort=tau)
        if self._stiffness.size:
            self.joints('position_offset', stamp, position_offset(
                tau, self._stiffness, self._max_offset))

    def diagnostics(self, statuses: Sequence[Status]) -> None:
        """Publish /diagnostics."""
        self._diagnostics.publish(self._array(statuses))

    def model(self, entry: Entry | None) -> None:
        """Publish the numbers of another model in use (`export.c_source`), and its payload."""
        if entry is None or entry is self._sent_model:
            return
        self._sent_model = entry
        self._model.publish(model_message(parameters_of(entry.model)))
        try:
            payload = payload_of(entry.model)
        except DataError:
            payload = None
        self._payload.publish(payload_message(payload, self._node.get_clock().now().to_msg()))

    def checks(self, decision: str) -> None:
        """Publish the checks of a decision, as JSON."""
        self._managed['checks'].publish(String(data=decision))

    def payload_suspected(self, found: PayloadResult) -> None:
        """Publish the suspicion of an unannounced payload, with its evidence."""
        topic = 'payload_suspected'
        self._managed[topic].publish(self._array([Status(topic, WARN, found.text, found.values)]))

    def _array(self, statuses: Sequence[Status]) -> DiagnosticArray:
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        # With the namespace, which distinguishes several arms.
        name = self._node.get_fully_qualified_name().lstrip('/')
        message.status = [DiagnosticStatus(
            level=bytes([status.level]), name=f'{name}: {status.name}', message=status.message,
            hardware_id=name,
            values=[KeyValue(key=key, value=value) for key, value in status.values.items()])
            for status in statuses]
        return message

    def destroy(self) -> None:
        """Destroy all publishers."""
        for each in (*self._managed.values(), self._diagnostics, self._model, self._payload):
            self._node.destroy_lifecycle_publisher(each)
