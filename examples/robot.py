"""The robot of the demo: plays recorded joint states over DDS and hears what the node answers."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from gravity_comp_ros.data.samples import FloatArray, JointSamples
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data, QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

NODE = '/gravity_comp'
# The node's answers may trail behind the last joint state by this long, s.
_ROUNDS = 4
_PATIENCE = 5.0


class DemoError(Exception):
    """The demo cannot go on; the message says why."""


class Robot:
    """
    A ROS node that stands for the arm and its operator.

    :param speed: how many seconds of a recording are played in one second.
    :param alive: tells whether the node under test still runs.
    """

    def __init__(self, joints: tuple[str, ...], speed: float, alive: Callable[[], bool]) -> None:
        self.joints = joints
        self._speed = speed
        self._alive = alive
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node('demo_robot', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._publisher = self._node.create_publisher(JointState, '/joint_states', QoSProfile(
            depth=100))
        self._node.create_subscription(JointState, f'{NODE}/prediction', self._heard,
                                       qos_profile_sensor_data)
        self._predicted: dict[int, FloatArray] = {}
        # Stamps go on from recording to recording, as a robot's clock does.
        self._clock_ns = 1_000_000_000_000

    def close(self) -> None:
        """Leave the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def connect(self, timeout: float) -> None:
        """Wait until the node hears joint states and offers its services."""
        self._wait(lambda: self._publisher.get_subscription_count() > 0, timeout,
                   'the node does not subscribe to /joint_states')

    def call(self, service: str, timeout: float) -> tuple[bool, str]:
        """Call a `std_srvs/Trigger` of the node; return its success and its message."""
        client = self._node.create_client(Trigger, f'{NODE}/{service}')
        try:
            self._wait(client.service_is_ready, 10.0, f'there is no service {NODE}/{service}')
            future = client.call_async(Trigger.Request())
            self._wait(future.done, timeout, f'{NODE}/{service} does not answer')
            reply = future.result()
            return reply.success, reply.message
        finally:
            self._node.destroy_client(client)

    def play(self, samples: JointSamples, with_effort: bool = True) -> list[int]:
        """
        Publish samples in their own rhythm, faster by `speed`; return the stamps used, ns.

        Without effort the node can predict, but has nothing to learn from.
        """
        start, stamps = time.monotonic(), []
        for k in range(samples.n_samples):
            elapsed = samples.t[k] - samples.t[0]
            self._spin_until(start + elapsed / self._speed)
            stamp = self._clock_ns + round(elapsed * 1e9)
            self._publisher.publish(_message(samples, k, stamp, with_effort))
            stamps.append(stamp)
        self._clock_ns = stamps[-1] + 1_000_000_000
        return stamps

    def predictions(self, samples: JointSamples) -> tuple[JointSamples, FloatArray]:
        """
        Play samples without their effort; return those answered, and the answers in N·m.

        Joint states go out best effort, and a busy machine loses some: those are played again.

        :raises DemoError: if fewer than nine tenths are answered in the end.
        """
        answers: dict[int, FloatArray] = {}
        for _ in range(_ROUNDS):
            open_ = np.array([k for k in range(samples.n_samples) if k not in answers])
            if not open_.size:
                break
            self._predicted.clear()
            stamps = self.play(samples.select(open_), with_effort=False)
            deadline = time.monotonic() + _PATIENCE
            while len(self._predicted) < len(stamps) and time.monotonic() < deadline:
                self._spin_until(time.monotonic() + 0.05)
            answers |= {int(k): self._predicted[stamp] for k, stamp in zip(open_, stamps)
                        if stamp in self._predicted}
        if len(answers) < 0.9 * samples.n_samples:
            raise DemoError(f'{len(answers)} of {samples.n_samples} joint states were answered '
                            f'with a prediction on {NODE}/prediction')
        heard = np.array(sorted(answers), dtype=np.int64)
        return samples.select(heard), np.array([answers[k] for k in heard.tolist()])

    def _heard(self, message: Any) -> None:
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        effort = dict(zip(message.name, message.effort))
        self._predicted[stamp] = np.array([effort[joint] for joint in self.joints])

    def _spin_until(self, moment: float) -> None:
        while True:
            left = moment - time.monotonic()
            self._executor.spin_once(timeout_sec=max(left, 0.0))
            if left <= 0.0:
                return

    def _wait(self, ready: Callable[[], bool], timeout: float, otherwise: str) -> None:
        deadline = time.monotonic() + timeout
        while not ready():
            if not self._alive():
                raise DemoError('the node has ended')
            if time.monotonic() > deadline:
                raise DemoError(f'{otherwise} (waited {timeout:g} s)')
            self._executor.spin_once(timeout_sec=0.05)


def _message(samples: JointSamples, k: int, stamp: int, with_effort: bool) -> JointState:
    message = JointState()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    message.name = list(samples.names)
    message.position = samples.q[k].tolist()
    message.velocity = samples.qd[k].tolist()
    if with_effort:
        message.effort = samples.tau[k].tolist()
    return message
