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
from gravity_comp_ros.evaluation.external_torque import ExternalTorque
from gravity_comp_ros.export.c_source import parameters_of
from gravity_comp_ros.export.numbers import Parameters
from gravity_comp_ros.export.payload_lines import Payload, payload_of
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.diagnostics import Status, WARN
from gravity_comp_ros.node.parameters import Parameters as Settings
from gravity_comp_ros.node.watch import Suspicion
import numpy as np
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String

DEPTH = 10
# Late subscribers receive the last events with their stamps.
EVENT_QOS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=DEPTH,
                       reliability=ReliabilityPolicy.RELIABLE,
                       durability=DurabilityPolicy.TRANSIENT_LOCAL)
# A controller that starts later receives the last model.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def model_message(parameters: Parameters) -> Float64MultiArray:
    """
    Return the numbers of a model as a message, for a controller that runs the exported C source.

    `layout.dim[0].label` is the layout in hexadecimal, its size the number of values; the labels
    of the other dimensions, all of size 1, name the values.
    """
    count = len(parameters.values)
    message = Float64MultiArray(data=parameters.values.tolist())
    message.layout.dim = [
        MultiArrayDimension(label=f'{parameters.layout:08x}', size=count, stride=count),
        *(MultiArrayDimension(label=label, size=1, stride=1) for label in parameters.labels)]
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


def position_offset(tau: FloatArray, stiffness: FloatArray, limit: float) -> FloatArray:
    """
    Return the angle (N,) in rad to add to the goals of servos for a torque (N,) in N·m.

    :param stiffness: (N,) or (1,) in N·m/rad. :param limit: largest offset in rad.
    """
    return np.minimum(np.maximum(tau / stiffness, -limit), limit)


class Outputs:
    """
    All publishers of the node.

    :param node: lifecycle node; its state enables the managed publishers.
    :param settings: for the position offset.
    """

    def __init__(self, node: LifecycleNode, settings: Settings) -> None:
        self._node = node
        self._stiffness = np.array(settings.servo_stiffness)
        self._max_offset = settings.max_position_offset
        self._offsets = None if not settings.servo_stiffness else \
            node.create_lifecycle_publisher(JointState, '~/position_offset', DEPTH)
        self._offset = JointState()
        self._torques = node.create_lifecycle_publisher(JointState, '~/gravity_torques', DEPTH)
        self._commands = node.create_lifecycle_publisher(
            Float64MultiArray, '~/commands', DEPTH)
        self._prediction = node.create_lifecycle_publisher(JointState, '~/prediction', DEPTH)
        self._residual = node.create_lifecycle_publisher(JointState, '~/residual', DEPTH)
        self._extrapolation = node.create_lifecycle_publisher(
            JointState, '~/extrapolation', DEPTH)
        # External torque, its standard deviation, and the torque where it is significant.
        self._external = [node.create_lifecycle_publisher(JointState, f'~/external_torque{end}',
                                                          DEPTH)
                          for end in ('', '_std', '_significant')]
        self._suspected = node.create_lifecycle_publisher(
            DiagnosticArray, '~/payload_suspected', EVENT_QOS)
        self._checks = node.create_lifecycle_publisher(String, '~/checks', EVENT_QOS)
        # Not managed, so that an inactive node publishes diagnostics and its model.
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', DEPTH)
        self._model = node.create_publisher(Float64MultiArray, '~/model', LATCHED)
        self._payload = node.create_publisher(InertiaStamped, '~/payload', LATCHED)
        self._torque, self._predicted = JointState(), JointState()
        self._difference, self._outside = JointState(), JointState()
        self._from_outside = JointState()
        self._command = Float64MultiArray()
        self._command.layout.data_offset = 0
        # Whether these topics have subscribers.
        self.publishes_prediction = self.publishes_residual = self.publishes_extrapolation = False
        self.publishes_external_torque = False

    def name_joints(self, joints: Sequence[str]) -> None:
        """Write the joint names into all messages."""
        for message in (self._torque, self._predicted, self._difference, self._outside,
                        self._from_outside, self._offset):
            message.name = list(joints)

    def update_subscriptions(self) -> None:
        """Find which topics have subscribers; too slow to call for each message."""
        self.publishes_prediction = self._prediction.get_subscription_count() > 0
        self.publishes_residual = self._residual.get_subscription_count() > 0
        self.publishes_extrapolation = self._extrapolation.get_subscription_count() > 0
        self.publishes_external_torque = any(publisher.get_subscription_count() > 0
                                             for publisher in self._external)

    def torque(self, stamp: Time, tau: FloatArray) -> None:
        """Publish the feed-forward (N,) in N·m, as joint state, command and position offset."""
        values = array('d', tau.tobytes())
        self._command.data = values
        self._commands.publish(self._command)
        self._torque.header.stamp = stamp
        self._torque.effort = values
        self._torques.publish(self._torque)
        if self._offsets is not None:
            self._offset.header.stamp = stamp
            self._offset.position = array('d', position_offset(
                tau, self._stiffness, self._max_offset).tobytes())
            self._offsets.publish(self._offset)

    def prediction(self, stamp: Time, q: FloatArray, tau: FloatArray) -> None:
        """Publish the model's torque (N,) in N·m at pose q (N,), without ramp and limits."""
        self._fill(self._predicted, stamp, q, tau)
        self._prediction.publish(self._predicted)

    def residual(self, stamp: Time, q: FloatArray, tau: FloatArray) -> None:
        """Publish measured minus predicted torque (N,) in N·m."""
        self._fill(self._difference, stamp, q, tau)
        self._residual.publish(self._difference)

    def external_torque(self, stamp: Time, q: FloatArray, external: ExternalTorque) -> None:
        """Publish external torque, its standard deviation, and its significant values."""
        significant = np.where(external.significant, external.torque, 0.0)
        for publisher, values in zip(self._external,
                                     (external.torque, external.std, significant)):
            self._fill(self._from_outside, stamp, q, values)
            publisher.publish(self._from_outside)

    def extrapolation(self, stamp: Time, distance: FloatArray, std: FloatArray) -> None:
        """
        Publish the extrapolation of the model at the present pose.

        :param distance: distance outside the trained range (N,) in rad.
        :param std: standard deviation of the model's torque (N,) in N·m, or empty.
        """
        self._fill(self._outside, stamp, distance, std)
        self._extrapolation.publish(self._outside)

    def diagnostics(self, statuses: Sequence[Status]) -> None:
        """Publish /diagnostics."""
        self._diagnostics.publish(self._array(statuses))

    def model(self, model: GravityModel) -> None:
        """Publish the numbers of the model in use (`export.c_source`), and its payload."""
        self._model.publish(model_message(parameters_of(model)))
        try:
            payload = payload_of(model)
        except DataError:
            payload = None
        self._payload.publish(payload_message(payload, self._node.get_clock().now().to_msg()))

    def checks(self, decision: str) -> None:
        """Publish the checks of a decision, as JSON."""
        self._checks.publish(String(data=decision))

    def payload_suspected(self, suspicion: Suspicion) -> None:
        """Publish the suspicion of an unannounced payload, with its evidence."""
        self._suspected.publish(self._array([
            Status('payload_suspected', WARN, suspicion.text, suspicion.values)]))

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
        for publisher in (self._torques, self._commands, self._prediction, self._residual,
                          self._extrapolation, *self._external, self._suspected,
                          self._checks, *([self._offsets] if self._offsets else [])):
            self._node.destroy_lifecycle_publisher(publisher)
        for each in (self._diagnostics, self._model, self._payload):
            self._node.destroy_publisher(each)

    @staticmethod
    def _fill(message: JointState, stamp: Time, q: FloatArray, tau: FloatArray) -> None:
        message.header.stamp = stamp
        message.position = array('d', q.tobytes())
        message.effort = array('d', tau.tobytes())
