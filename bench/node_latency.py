#!/usr/bin/env python3
"""
From joint state to torque: the node against a bare rclpy echo node, in turns in one run.

    python3 bench/node_latency.py [--rate 1000] [--seconds 10] [--turns 3] [--fits] [--json F]

Both get the same joint states of seven joints; the time from publish to answer is measured at the
sender. The turns alternate, so that what else the machine does hits both. `--fits` asks for a fit
all the time while the node is measured. Prints loss, p50, p90, p99 of both and the ratio of p99,
and the node's memory before and after.
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time

from gravity_comp_ros.bag import read_bag
from gravity_comp_ros.gravity.fit import fit
from gravity_comp_ros.modelfile import save_model
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


def echo() -> None:
    """Run the rival: a node that sends every joint state back."""
    rclpy.init()
    node = Node('bare_echo')
    publisher = node.create_publisher(JointState, 'gravity_comp/gravity_torques', 10)
    node.create_subscription(JointState, 'joint_states', publisher.publish, BEST_EFFORT)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


class Sender:
    """Sends joint states at a rate, and measures when each is answered."""

    def __init__(self, rate: float) -> None:
        self.node = Node('sender')
        self.publisher = self.node.create_publisher(JointState, 'joint_states', BEST_EFFORT)
        self.heard = self.node.create_subscription(
            JointState, 'gravity_comp/gravity_torques', lambda _: None, BEST_EFFORT)
        self.refit = self.node.create_client(Trigger, 'gravity_comp/refit')
        self._period = int(1e9 / rate)
        samples = read_bag(ROOT / 'bags' / 'eq17_later.mcap').samples
        self._samples, self._k = samples, 0
        self._message = JointState(name=list(samples.names))
        self._wait = rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, self.node.context.handle)

    def until_known(self) -> None:
        end = time.monotonic() + 30.0
        while (self.publisher.get_subscription_count() < 1
               or self.heard.get_publisher_count() < 1):
            if time.monotonic() > end:
                raise SystemExit('the other node does not appear')
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def run(self, seconds: float, fits: bool) -> tuple[int, np.ndarray]:
        """Return how many were sent, and the times of the answers in ms."""
        times: list[int] = []
        self._open: set[int] = set()
        start = due = time.perf_counter_ns()
        sent = 0
        while due - start < seconds * 1e9:
            due += self._period
            while (left := due - time.perf_counter_ns()) > 0:
                self._take(times, left)
            if fits and sent % 200 == 0:
                self.refit.call_async(Trigger.Request())
            self._send()
            sent += 1
        self._take(times, 200_000_000)
        return sent, np.array(times) / 1e6

    def _send(self) -> None:
        message, k = self._message, self._k % len(self._samples)
        self._k += 1
        message.position = self._samples.q[k].tolist()
        message.velocity = self._samples.qd[k].tolist()
        message.effort = self._samples.tau[k].tolist()
        now = time.perf_counter_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
        self._open.add(now)
        self.publisher.publish(message)

    def _take(self, times: list[int], wait_ns: int) -> None:
        self._wait.clear_entities()
        self._wait.add_subscription(self.heard.handle)
        self._wait.wait(wait_ns)
        while (taken := self.heard.handle.take_message(JointState, False)) is not None:
            stamp = taken[0].header.stamp
            then = stamp.sec * 1_000_000_000 + stamp.nanosec
            # Late answers to the run before, and torques on stale input, answer nothing here.
            if then in self._open:
                self._open.remove(then)
                times.append(time.perf_counter_ns() - then)


def measure(command: list[str], rate: float, seconds: float, fits: bool
            ) -> tuple[int, np.ndarray, list[float]]:
    """Start a node, measure it, and return sent, times in ms, memory in MiB during it."""
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        sender = Sender(rate)
        sender.until_known()
        sender.run(2.0, False)
        before = memory(process.pid)
        sent, times = sender.run(seconds, fits)
        after = memory(process.pid)
        sender.node.destroy_node()
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()
    return sent, times, [before, after]


def memory(pid: int) -> float:
    """Return the resident memory of a process in MiB."""
    pages = int(Path(f'/proc/{pid}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 2 ** 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--rate', type=float, default=1000.0)
    parser.add_argument('--seconds', type=float, default=10.0)
    parser.add_argument('--turns', type=int, default=3)
    parser.add_argument('--fits', action='store_true')
    parser.add_argument('--json', type=Path)
    parser.add_argument('--echo', action='store_true', help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.echo:
        return echo()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    rclpy.init()
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / 'model.json'
        save_model(model, fit(read_bag(ROOT / 'bags' / 'eq17_unloaded.mcap').samples).model)
        commands = {
            'echo': [sys.executable, __file__, '--echo'],
            'node': [sys.executable, '-m', 'gravity_comp_ros.node.main', '--ros-args',
                     '-p', f'model_file:={model}', '-p', 'max_torque:=[200.0]',
                     '-p', 'sample_rate:=50.0']}
        found: dict[str, list] = {name: [] for name in commands}
        for _ in range(args.turns):
            for name, command in commands.items():
                found[name].append(measure(command, args.rate, args.seconds,
                                           args.fits and name == 'node'))
    result = {name: summary(turns) for name, turns in found.items()}
    result['p99_ratio'] = result['node']['p99'] / result['echo']['p99']
    for name in commands:
        figures = result[name]
        print(f'{name}: sent {figures["sent"]}, lost {figures["lost"]}; '
              f'p50 {figures["p50"]:.3f} ms, p90 {figures["p90"]:.3f} ms, '
              f'p99 {figures["p99"]:.3f} ms; memory {figures["memory"]}')
    print(f'p99 of the node is {result["p99_ratio"]:.2f} times that of the bare echo')
    if args.json:
        args.json.write_text(json.dumps(result, indent=1) + '\n')


def summary(turns: list) -> dict:
    times = np.concatenate([turn[1] for turn in turns])
    sent = sum(turn[0] for turn in turns)
    p50, p90, p99 = np.percentile(times, [50, 90, 99])
    return {'sent': sent, 'lost': sent - len(times), 'p50': p50, 'p90': p90, 'p99': p99,
            'memory': [[round(x, 1) for x in turn[2]] for turn in turns]}


if __name__ == '__main__':
    main()
