"""Robot of the demo: playback of recorded joint states over DDS, and the node's predictions."""

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
# Maximum number of playbacks until all samples have a prediction.
_MAX_ROUNDS = 4
# Maximum delay of predictions after the last joint state, s.
_TIMEOUT = 5.0


class DemoError(Exception):
    """The demo failed; the message gives the reason."""


class Robot:
    """
    ROS node in place of the arm and its operator.

    :param speed: playback speed, recorded seconds per second.
    :param alive: returns whether the node under test is running.
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
        self._node.create_subscription(JointState, f'{NODE}/prediction', self._received,
                                       qos_profile_sensor_data)
        self._predicted: dict[int, FloatArray] = {}
        # Stamps increase from recording to recording, like the clock of a robot.
        self._clock_ns = 1_000_000_000_000

    def close(self) -> None:
        """Leave the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def connect(self, timeout: float) -> None:
        """Wait until the node has subscribed to the joint states."""
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
        Publish samples at `speed` times real time; return their stamps, ns.

        Without effort the node predicts but does not learn.
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
        Play samples without effort; return those with a prediction, and the predictions, N·m.

        Samples without a prediction are played again: joint states are sent best effort, so that
        a busy machine loses some.

        :raises DemoError: if fewer than nine tenths have a prediction.
        """
        predictions: dict[int, FloatArray] = {}
        for _ in range(_MAX_ROUNDS):
            missing = np.array([k for k in range(samples.n_samples) if k not in predictions])
            if not missing.size:
                break
            self._predicted.clear()
            stamps = self.play(samples.select(missing), with_effort=False)
            deadline = time.monotonic() + _TIMEOUT
            while len(self._predicted) < len(stamps) and time.monotonic() < deadline:
                self._spin_until(time.monotonic() + 0.05)
            predictions |= {int(k): self._predicted[stamp] for k, stamp in zip(missing, stamps)
                            if stamp in self._predicted}
        if len(predictions) < 0.9 * samples.n_samples:
            raise DemoError(f'{len(predictions)} of {samples.n_samples} joint states had a '
                            f'prediction on {NODE}/prediction')
        rows = np.array(sorted(predictions), dtype=np.int64)
        return samples.select(rows), np.array([predictions[k] for k in rows.tolist()])

    def _received(self, message: Any) -> None:
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        effort = dict(zip(message.name, message.effort))
        self._predicted[stamp] = np.array([effort[joint] for joint in self.joints])

    def _spin_until(self, moment: float) -> None:
        while True:
            remaining = moment - time.monotonic()
            self._executor.spin_once(timeout_sec=max(remaining, 0.0))
            if remaining <= 0.0:
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
