#!/usr/bin/env python3
"""
Latency from joint state to torque, of the node and of a bare rclpy echo node.

    python3 -m bench.node_latency [--rate 1000] [--seconds 60] [--fits] [--realtime] [--turns N]
                                  [--events] [--json F]

Both receive the same joint states of seven joints in slow motion. The sender measures the time
from publication to reply. By default both run at once on the same messages, so that other load
affects both; with `--turns N` they run alternately, N times each. `--events` adds the node on
`rclpy.experimental.EventsExecutor` in place of its own executor. `--fits` requests fits
continuously. `--realtime` (as root) gives sender, echo and node, but not the fit process, the
priority of a control loop (SCHED_FIFO). Prints loss, p50, p90 and p99 of both, the ratio of p99,
CPU, memory, the number of fits, and the time of one prediction.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model, save_model
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
TOPICS = {'echo': 'echo', 'node': 'gravity_comp/gravity_torques',
          'events': 'on_events/gravity_torques'}
SERVED = ('node', 'events')
MEMORY_EVERY = 5.0


def echo() -> None:
    """Run the reference: a node that sends each joint state back."""
    rclpy.init()
    node = Node('bare_echo')
    publisher = node.create_publisher(JointState, TOPICS['echo'], 10)
    node.create_subscription(JointState, 'joint_states', publisher.publish, BEST_EFFORT)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


def on_events(args: list[str]) -> None:
    """Run the node on `EventsExecutor`, which handles all callbacks in the order of arrival."""
    from gravity_comp_ros.node import run
    from rclpy.experimental import EventsExecutor
    run.InputFirstExecutor = lambda *_: EventsExecutor()  # type: ignore[misc, assignment]
    sys.exit(run.run([sys.argv[0], *args]))


def motion(rate: float) -> tuple[tuple[str, ...], np.ndarray]:
    """Return joint names and a slow motion forward and backward (M, 3, N): q, qd, tau."""
    samples = read_bag(ROOT / 'bags' / 'eq17_unloaded.mcap').samples
    t = np.arange(samples.t[0], samples.t[-1], 1.0 / rate)
    forward = np.stack([np.stack([np.interp(t, samples.t, x) for x in values.T], axis=1)
                        for values in (samples.q, samples.qd, samples.tau)], axis=1)
    forward[:, 2] += np.random.default_rng(0).normal(0.0, 0.1, forward[:, 2].shape)
    backward = forward[::-1] * np.array([1.0, -1.0, 1.0])[:, None]
    return samples.names, np.concatenate((forward, backward))


@dataclass
class Measured:
    """Measurements of one node: latencies in ms, memory in MiB, CPU time per second."""

    sent: int = 0
    times: list[float] = field(default_factory=list)
    memory: list[float] = field(default_factory=list)
    cpu: float = 0.0


class Sender:
    """Sends joint states at a rate, and measures the latency of the replies of each node."""

    def __init__(self, rate: float, names: list[str]) -> None:
        self.node = Node('sender')
        self.publisher = self.node.create_publisher(JointState, 'joint_states', BEST_EFFORT)
        self.replies = {name: self.node.create_subscription(
            JointState, TOPICS[name], lambda _: None, BEST_EFFORT) for name in names}
        self.refits = [self.node.create_client(
            Trigger, TOPICS[name].replace('gravity_torques', 'refit'))
            for name in names if name in SERVED]
        self.fits: list[str] = []
        self.received = 0
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_report, 10)
        self._futures: list[Any] = [None for _ in self.refits]
        self._period = int(1e9 / rate)
        joints, self._motion = motion(rate)
        self._k = 0
        self._message = JointState(name=list(joints))
        self._wait = rclpy_implementation.WaitSet(
            len(names), 0, 0, 0, 0, 0, self.node.context.handle)

    def until_connected(self) -> None:
        end = time.monotonic() + 60.0
        while (self.publisher.get_subscription_count() < len(self.replies)
               or any(h.get_publisher_count() < 1 for h in self.replies.values())):
            if time.monotonic() > end:
                raise SystemExit('the other node does not appear')
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def run(self, seconds: float, fits: bool, pids: dict[str, int]) -> dict[str, Measured]:
        """Send for some seconds; return the measurements of each node."""
        measured = {name: Measured() for name in self.replies}
        self._open: dict[str, set[int]] = {name: set() for name in self.replies}
        before = {name: cpu_seconds(pid) for name, pid in pids.items()}
        start = due = time.perf_counter_ns()
        sent, memory_due = 0, 0.0
        while due - start < seconds * 1e9:
            due += self._period
            while (remaining := due - time.perf_counter_ns()) > 0:
                self._receive(measured, remaining)
            self._send()
            sent += 1
            if sent % 100 == 50 and self.refits:
                rclpy.spin_once(self.node, timeout_sec=0)
                self._request_fit(fits)
            if (due - start) / 1e9 >= memory_due:
                memory_due += MEMORY_EVERY
                for name, pid in pids.items():
                    measured[name].memory.append(memory(pid))
        self._receive(measured, 200_000_000)
        for name, pid in pids.items():
            measured[name].cpu = (cpu_seconds(pid) - before[name]) / seconds
        for each in measured.values():
            each.sent = sent
        return measured

    def last_report(self) -> int:
        """Return the number of messages received by the node, once it no longer rises."""
        end, before = time.monotonic() + 5.0, -1
        while time.monotonic() < end and before != self.received:
            before, pause = self.received, time.monotonic() + 1.5
            while time.monotonic() < pause:
                rclpy.spin_once(self.node, timeout_sec=0.1)
        return self.received

    def _request_fit(self, fits: bool) -> None:
        for k, future in enumerate(self._futures):
            if future is not None and future.done():
                self.fits.append(future.result().message)
                future = None
            if fits and future is None:
                future = self.refits[k].call_async(Trigger.Request())
            self._futures[k] = future

    def _on_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == 'gravity_comp: input':
                values = {pair.key: pair.value for pair in status.values}
                self.received = int(values['messages'])

    def _send(self) -> None:
        message, now = self._message, time.perf_counter_ns()
        q, qd, tau = self._motion[self._k % len(self._motion)]
        self._k += 1
        message.position, message.velocity = q.tolist(), qd.tolist()
        message.effort = tau.tolist()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
        for waiting in self._open.values():
            waiting.add(now)
        self.publisher.publish(message)

    def _receive(self, measured: dict[str, Measured], wait_ns: int) -> None:
        self._wait.clear_entities()
        for replies in self.replies.values():
            self._wait.add_subscription(replies.handle)
        self._wait.wait(wait_ns)
        for name, replies in self.replies.items():
            waiting = self._open[name]
            while (reply := replies.handle.take_message(JointState, False)) is not None:
                stamp = reply[0].header.stamp
                then = stamp.sec * 1_000_000_000 + stamp.nanosec
                # Late replies of the previous run and torques on stale input are not waited for.
                if then in waiting:
                    waiting.remove(then)
                    measured[name].times.append((time.perf_counter_ns() - then) / 1e6)


def measure(commands: dict[str, list[str]], args: argparse.Namespace, fits: bool
            ) -> tuple[dict[str, Measured], Sender, int]:
    """Start these nodes; return their measurements, the sender, and the messages lost."""
    processes = {name: subprocess.Popen(command, stderr=subprocess.DEVNULL,
                                        stdout=subprocess.DEVNULL)
                 for name, command in commands.items()}
    try:
        sender = Sender(args.rate, list(commands))
        sender.until_connected()
        if args.realtime:
            for pid in (os.getpid(), *(process.pid for process in processes.values())):
                realtime(pid)
        sender.run(12.0 if fits else 3.0, False, {})
        before = sender.last_report() if 'node' in commands else 0
        measured = sender.run(args.seconds, fits, {n: p.pid for n, p in processes.items()})
        lost = 0
        if 'node' in commands:
            lost = measured['node'].sent - (sender.last_report() - before)
        sender.node.destroy_node()
    finally:
        for process in processes.values():
            process.send_signal(signal.SIGINT)
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
    return measured, sender, lost


def realtime(pid: int) -> None:
    """Give all threads of a process real-time priority; its children keep theirs."""
    for thread in Path(f'/proc/{pid}/task').iterdir():
        os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, os.sched_param(10))


def memory(pid: int) -> float:
    """Return the resident memory of a process in MiB."""
    pages = int(Path(f'/proc/{pid}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 2 ** 20


def cpu_seconds(pid: int) -> float:
    """Return the CPU time of a process in s, with its threads and without its children."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def prediction(model: GravityModel) -> float:
    """Return the median time of a prediction in µs."""
    q = motion(100.0)[1][:1000, 0]
    times = []
    for pose in q:
        start = time.perf_counter_ns()
        model.predict_one(pose)
        times.append(time.perf_counter_ns() - start)
    return float(np.median(times)) / 1e3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--rate', type=float, default=1000.0)
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument('--turns', type=int, default=0)
    parser.add_argument('--fits', action='store_true')
    parser.add_argument('--realtime', action='store_true')
    parser.add_argument('--json', type=Path)
    parser.add_argument('--events', action='store_true')
    parser.add_argument('--echo', action='store_true', help=argparse.SUPPRESS)
    if '--on-events' in sys.argv:
        return on_events(sys.argv[2:])
    args = parser.parse_args()
    if args.echo:
        return echo()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    rclpy.init()
    with tempfile.TemporaryDirectory() as folder:
        result = compare(args, Path(folder) / 'model.json')
    show(result)
    if args.json:
        args.json.write_text(json.dumps(result, indent=1) + '\n')


def compare(args: argparse.Namespace, model: Path) -> dict:
    """Run both nodes, at once or alternately; return the figures."""
    save_model(model, fit(read_bag(ROOT / 'bags' / 'eq17_unloaded.mcap').samples).model)
    options = ['--ros-args', '-p', f'model_file:={model}', '-p', 'max_torque:=[200.0]',
               '-p', 'max_age:=0.0', '-p', 'sample_rate:=50.0']
    commands = {
        'echo': [sys.executable, __file__, '--echo'],
        'node': [sys.executable, '-m', 'gravity_comp_ros.node.main', *options]}
    if args.events:
        commands['events'] = [sys.executable, __file__, '--on-events', *options,
                              '-r', '__node:=on_events']
    runs: list[tuple[dict[str, Measured], Sender, int]] = []
    if args.turns:
        for _ in range(args.turns):
            runs += [measure({name: command}, args, args.fits and name in SERVED)
                     for name, command in commands.items()]
    else:
        runs.append(measure(commands, args, args.fits))
    result: dict = {name: summary([measured[name] for measured, _, _ in runs if name in measured])
                    for name in commands}
    result['p99_ratio'] = {name: result[name]['p99'] / result['echo']['p99']
                           for name in commands if name in SERVED}
    result['lost_in_node'] = sum(lost for _, _, lost in runs)
    answers = [text for _, sender, _ in runs for text in sender.fits]
    result['fits'] = sum('held-out RMSE' in text for text in answers)
    result['predict_us'] = prediction(load_model(model))
    result['together'] = not args.turns
    return result


def summary(runs: list[Measured]) -> dict:
    # A node that never replied has no finite percentile.
    times = np.concatenate([run.times for run in runs])
    sent = sum(run.sent for run in runs)
    p50, p90, p99 = np.percentile(times if len(times) else [np.inf], [50, 90, 99])
    # Without the first minute, in which caches and the sample buffer fill.
    skip = int(60.0 / MEMORY_EVERY)
    late = [x for run in runs for x in (run.memory[skip:] or run.memory)]
    return {'sent': sent, 'unanswered': sent - len(times), 'p50': p50, 'p90': p90, 'p99': p99,
            'cpu': float(np.mean([run.cpu for run in runs])),
            'memory_first_MiB': runs[0].memory[0], 'memory_MiB': [min(late), max(late)]}


def show(result: dict) -> None:
    for name in filter(result.get, TOPICS):
        r = result[name]
        print(f'{name}: CPU {r["cpu"]:.0%} of a core; sent {r["sent"]}, unanswered '
              f'{r["unanswered"]}; p50 {r["p50"]:.3f} ms, p90 {r["p90"]:.3f} ms, p99 '
              f'{r["p99"]:.3f} ms; memory {r["memory_first_MiB"]:.1f} MiB at first, then '
              f'{r["memory_MiB"][0]:.1f} to {r["memory_MiB"][1]:.1f}')
    print(f'messages lost on input of the node: {result["lost_in_node"]}; fits: '
          f'{result["fits"]}; one prediction: {result["predict_us"]:.1f} µs')
    how = 'at once' if result['together'] else 'alternately'
    for name, ratio in result['p99_ratio'].items():
        print(f'p99 of {name} is {ratio:.2f} times that of the bare echo (run {how})')


if __name__ == '__main__':
    main()
