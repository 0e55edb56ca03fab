"""The node's publishers, with messages that are made once and filled again."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.node.diagnostics import Status, WARN
from gravity_comp_ros.node.payload_watch import Suspicion
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

DEPTH = 10
# Who subscribes later still receives the last events; their stamps say of when they are.
EVENT_QOS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=DEPTH,
                       reliability=ReliabilityPolicy.RELIABLE,
                       durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Outputs:
    """
    Everything that the node publishes.

    :param node: its lifecycle decides whether anything leaves.
    """

    def __init__(self, node: LifecycleNode) -> None:
        self._node = node
        self._torques = node.create_lifecycle_publisher(JointState, '~/gravity_torques', DEPTH)
        self._commands = node.create_lifecycle_publisher(
            Float64MultiArray, '~/commands', DEPTH)
        self._prediction = node.create_lifecycle_publisher(JointState, '~/prediction', DEPTH)
        self._residual = node.create_lifecycle_publisher(JointState, '~/residual', DEPTH)
        self._extrapolation = node.create_lifecycle_publisher(
            JointState, '~/extrapolation', DEPTH)
        self._suspected = node.create_lifecycle_publisher(
            DiagnosticArray, '~/payload_suspected', EVENT_QOS)
        # Not a managed one: a node that was told to be inactive still says so.
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', DEPTH)
        self._torque, self._predicted, self._rest = JointState(), JointState(), JointState()
        self._outside = JointState()
        self._command = Float64MultiArray()
        self._command.layout.data_offset = 0
        self.prediction_wanted = self.residual_wanted = self.extrapolation_wanted = False

    def name_joints(self, joints: Sequence[str]) -> None:
        """Write the joint names into all messages."""
        for message in (self._torque, self._predicted, self._rest, self._outside):
            message.name = list(joints)

    def look_around(self) -> None:
        """Find out which topics anybody listens to; not a thing to do a thousand times a s."""
        self.prediction_wanted = self._prediction.get_subscription_count() > 0
        self.residual_wanted = self._residual.get_subscription_count() > 0
        self.extrapolation_wanted = self._extrapolation.get_subscription_count() > 0

    def torque(self, stamp: Time, tau: FloatArray) -> None:
        """Publish the feed-forward (N,) in N·m, as joint state and as command."""
        values = array('d', tau.tobytes())
        self._command.data = values
        self._commands.publish(self._command)
        self._torque.header.stamp = stamp
        self._torque.effort = values
        self._torques.publish(self._torque)

    def prediction(self, stamp: Time, q: FloatArray, tau: FloatArray) -> None:
        """Publish the model's torque (N,) in N·m at pose q (N,), as it is."""
        self._fill(self._predicted, stamp, q, tau)
        self._prediction.publish(self._predicted)

    def residual(self, stamp: Time, q: FloatArray, tau: FloatArray) -> None:
        """Publish measured minus predicted torque (N,) in N·m."""
        self._fill(self._rest, stamp, q, tau)
        self._residual.publish(self._rest)

    def extrapolation(self, stamp: Time, distance: FloatArray, std: FloatArray) -> None:
        """
        Publish how far the pose is from what the model knows.

        :param distance: outside the trained range (N,) in rad.
        :param std: of the model's own torque (N,) in N·m, or empty.
        """
        self._fill(self._outside, stamp, distance, std)
        self._extrapolation.publish(self._outside)

    def diagnostics(self, statuses: Sequence[Status]) -> None:
        """Publish /diagnostics."""
        self._diagnostics.publish(self._array(statuses))

    def payload_suspected(self, suspicion: Suspicion) -> None:
        """Publish a payload that the node was not told of, with its evidence."""
        self._suspected.publish(self._array([
            Status('payload_suspected', WARN, suspicion.text, suspicion.values)]))

    def _array(self, statuses: Sequence[Status]) -> DiagnosticArray:
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        # With its namespace, so that two arms are told apart.
        name = self._node.get_fully_qualified_name().lstrip('/')
        message.status = [DiagnosticStatus(
            level=bytes([status.level]), name=f'{name}: {status.name}', message=status.message,
            hardware_id=name,
            values=[KeyValue(key=key, value=value) for key, value in status.values.items()])
            for status in statuses]
        return message

    def destroy(self) -> None:
        """Take everything off the network."""
        for publisher in (self._torques, self._commands, self._prediction, self._residual,
                          self._extrapolation, self._suspected):
            self._node.destroy_lifecycle_publisher(publisher)
        self._node.destroy_publisher(self._diagnostics)

    @staticmethod
    def _fill(message: JointState, stamp: Time, q: FloatArray, tau: FloatArray) -> None:
        message.header.stamp = stamp
        message.position = array('d', q.tobytes())
        message.effort = array('d', tau.tobytes())
