#!/usr/bin/env python3
"""
Latency from joint state to torque of the node and of a bare rclpy echo, without and with fits.

    python3 -m bench.node_latency [--rate 1000] [--seconds 40] [--turn 2]

Joint states of seven joints in slow motion go to one of the two nodes at a time, in turns of some
seconds, so that other load affects both. The sender measures the time from publication to reply.
`--seconds` is the time for each node, first without fits, then with fits all the time. With the
defaults it takes three and a half minutes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.recordings.bag import read_bag
import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

ROOT = Path(__file__).resolve().parents[1]
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
# Topics to and from each node.
TOPICS = {'echo': ('to_echo', 'from_echo'),
          'node': ('to_node', 'gravity_comp/gravity_torques')}
# Motion before the first phase, and time for late replies at the end of a part, s.
WARM_UP, LATE = 10.0, 0.2
# Latencies of one phase in ms, and the number of messages, of each node.
Measured = dict[str, tuple[list[float], int]]


def echo() -> None:
    """Run the reference: a node that sends each joint state back."""
    rclpy.init()
    node = Node('bare_echo')
    publisher = node.create_publisher(JointState, TOPICS['echo'][1], 10)
    node.create_subscription(JointState, TOPICS['echo'][0], publisher.publish, BEST_EFFORT)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


def motion(rate: float) -> tuple[tuple[str, ...], np.ndarray]:
    """Return joint names and a slow motion forward and backward (M, 3, N): q, qd, tau."""
    samples = read_bag(ROOT / 'bags' / 'eq17_unloaded.mcap').samples
    t = np.arange(samples.t[0], samples.t[-1], 1.0 / rate)
    forward = np.stack([np.stack([np.interp(t, samples.t, x) for x in values.T], axis=1)
                        for values in (samples.q, samples.qd, samples.tau)], axis=1)
    forward[:, 2] += np.random.default_rng(0).normal(0.0, 0.1, forward[:, 2].shape)
    backward = forward[::-1] * np.array([1.0, -1.0, 1.0])[:, None]
    return samples.names, np.concatenate((forward, backward))


class Sender:
    """Sends joint states at a rate to one node at a time, and measures the latency of replies."""

    def __init__(self, rate: float) -> None:
        self.node = Node('sender')
        self._publishers = {name: self.node.create_publisher(JointState, to, BEST_EFFORT)
                            for name, (to, _) in TOPICS.items()}
        self._replies = {name: self.node.create_subscription(
            JointState, back, lambda _: None, BEST_EFFORT) for name, (_, back) in TOPICS.items()}
        self._refit = self.node.create_client(Trigger, 'gravity_comp/refit')
        self._future: Any = None
        self.fits = 0
        self._period = int(1e9 / rate)
        joints, self._motion = motion(rate)
        self._k = 0
        self._message = JointState(name=list(joints))
        self._wait_set = rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, self.node.context.handle)

    def until_connected(self) -> None:
        end = time.monotonic() + 60.0
        while any(each.get_subscription_count() < 1 for each in self._publishers.values()) or any(
                each.handle.get_publisher_count() < 1 for each in self._replies.values()):
            if time.monotonic() > end:
                raise SystemExit('the other nodes do not appear')
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def phase(self, seconds: float, turn: float, with_fits: bool) -> Measured:
        """Send to the nodes in turns, for some seconds to each; return their latencies."""
        measured: Measured = {name: ([], 0) for name in TOPICS}
        for _ in range(max(1, round(seconds / turn))):
            for name in TOPICS:
                times, sent = self.send(name, turn, self._request_fit if with_fits else None)
                measured[name] = measured[name][0] + times, measured[name][1] + sent
        return measured

    def send(self, name: str, seconds: float,
             meanwhile: Callable[[], None] | None = None) -> tuple[list[float], int]:
        """Send to one node for some seconds; return latencies in ms, and the number sent."""
        times: list[float] = []
        waiting: set[int] = set()
        start = due = time.perf_counter_ns()
        sent = 0
        while due - start < seconds * 1e9:
            due += self._period
            while (remaining := due - time.perf_counter_ns()) > 0:
                self._receive(name, waiting, times, remaining)
            waiting.add(self._publish(name))
            sent += 1
            if meanwhile is not None and sent % 100 == 50:
                meanwhile()
        end = time.perf_counter_ns() + int(LATE * 1e9)
        while waiting and (remaining := end - time.perf_counter_ns()) > 0:
            self._receive(name, waiting, times, remaining)
        return times, sent

    def _request_fit(self) -> None:
        rclpy.spin_once(self.node, timeout_sec=0)
        if self._future is not None and self._future.done():
            self.fits += 'held-out RMSE' in self._future.result().message
            self._future = None
        if self._future is None:
            self._future = self._refit.call_async(Trigger.Request())

    def _publish(self, name: str) -> int:
        """Publish the next joint state; return its stamp in ns."""
        message, now = self._message, time.perf_counter_ns()
        q, qd, tau = self._motion[self._k % len(self._motion)]
        self._k += 1
        message.position, message.velocity = q.tolist(), qd.tolist()
        message.effort = tau.tolist()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
        self._publishers[name].publish(message)
        return now

    def _receive(self, name: str, waiting: set[int], times: list[float], wait_ns: int) -> None:
        handle = self._replies[name].handle
        self._wait_set.clear_entities()
        self._wait_set.add_subscription(handle)
        self._wait_set.wait(wait_ns)
        while (reply := handle.take_message(JointState, False)) is not None:
            stamp = reply[0].header.stamp
            then = stamp.sec * 1_000_000_000 + stamp.nanosec
            # Late replies of the previous part are not waited for.
            if then in waiting:
                waiting.remove(then)
                times.append((time.perf_counter_ns() - then) / 1e6)


def compare(args: argparse.Namespace, model: Path) -> dict[str, Any]:
    """Run both nodes; return the figures of each phase."""
    save_model(model, fit(read_bag(ROOT / 'bags' / 'eq17_unloaded.mcap').samples).model)
    commands = {
        'echo': [sys.executable, __file__, '--echo'],
        'node': [sys.executable, '-m', 'gravity_comp_ros.node.main', '--ros-args',
                 '-r', f'joint_states:={TOPICS["node"][0]}', '-p', f'model_file:={model}',
                 '-p', 'max_torque:=[200.0]', '-p', 'max_age:=0.0', '-p', 'stale_after:=10.0']}
    processes = [subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
                 for command in commands.values()]
    try:
        sender = Sender(args.rate)
        sender.until_connected()
        for name in TOPICS:
            sender.send(name, WARM_UP)
        result = {label: figures(sender.phase(args.seconds, args.turn, with_fits))
                  for label, with_fits in (('without fits', False), ('with fits', True))}
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
    return {**result, 'fits': sender.fits}


def figures(measured: Measured) -> dict[str, Any]:
    """Return percentiles in ms, and the number of messages sent and not answered, of each node."""
    result: dict[str, Any] = {}
    for name, (times, sent) in measured.items():
        # A node that never replied has no finite percentile.
        p50, p99 = np.percentile(times or [np.inf], [50, 99])
        result[name] = {'p50': p50, 'p99': p99, 'sent': sent, 'unanswered': sent - len(times)}
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--rate', type=float, default=1000.0)
    parser.add_argument('--seconds', type=float, default=40.0)
    parser.add_argument('--turn', type=float, default=2.0)
    parser.add_argument('--echo', action='store_true', help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.echo:
        return echo()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    rclpy.init()
    with tempfile.TemporaryDirectory() as folder:
        result = compare(args, Path(folder) / 'model.json')
    for phase in ('without fits', 'with fits'):
        for name, r in result[phase].items():
            print(f'{phase:12} {name}: p50 {r["p50"]:.3f} ms, p99 {r["p99"]:.3f} ms; sent '
                  f'{r["sent"]}, unanswered {r["unanswered"]}')
        ratio = result[phase]['node']['p99'] / result[phase]['echo']['p99']
        print(f'{phase:12} p99 of the node is {ratio:.2f} times that of the echo')
    print(f'fits: {result["fits"]}')


if __name__ == '__main__':
    main()
