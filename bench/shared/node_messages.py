"""
`NodeCore` without ROS: messages and slow samples, its fits, and waiting.

The arm of most messages has two joints that do not load each other.
"""

import time

from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.node.checks import FIT
from gravity_comp_ros.node.epoch import Rows, SlowSample
from gravity_comp_ros.node.messages import CompleteReading
from gravity_comp_ros.node.node_core import NodeCore
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.worker.worker_process import Worker
import numpy as np
from sensor_msgs.msg import JointState


class Nodes:
    """
    Makes nodes without ROS, one after the other.

    A fit process is kept for the next node, as its start takes a second of processor time.
    """

    def __init__(self) -> None:
        self._open: list[NodeCore] = []
        self._ready: Worker | None = None

    def make(self, **settings) -> NodeCore:
        """Return a node with these parameters."""
        node = NodeCore(Parameters(**settings), '/joint_states', 0.0)
        if self._ready is not None:
            node.fits, self._ready = self._ready, None
            if node.learner is not None:
                node.learner.fits = node.fits
        self._open.append(node)
        return node

    def close(self) -> None:
        """Close the nodes, and keep the process of one of them."""
        for node in self._open:
            fits = node.fits
            if self._ready is None and fits.pid is not None and fits.job is None:
                self._ready, node.fits = fits, Worker(())
            node.close()
        self._open.clear()

    def end(self) -> None:
        """End the process that was kept."""
        if self._ready is not None:
            self._ready.rest()


def joint_state(names, t, q, qd=(), tau=()):
    """Return a joint state with stamp t in s."""
    message = JointState(name=list(names), position=[float(x) for x in q],
                         velocity=[float(x) for x in qd], effort=[float(x) for x in tau])
    message.header.stamp.sec = int(t)
    message.header.stamp.nanosec = min(int(round((t - int(t)) * 1e9)), 999_999_999)
    return message


def slow_sample(t, q, qd, tau, sent=float('nan')):
    """Return a slow sample before which the same torque was published at all joints, N·m."""
    return SlowSample(CompleteReading(t, q, qd, tau), np.full((2, len(q)), sent))


def rows_of(train, held_out):
    """Return the rows of training samples, and of held-out samples after them."""
    both = concatenate((train, held_out))
    return Rows(both, np.arange(len(both)) >= len(train))


def send_message(node, message, now, arrival=0.0):
    """Send a message to a `NodeCore` as its node does; return the reading and the torque."""
    reading = node.read(message, arrival)
    if reading is None:
        return None, None
    tau = node.arm.torque(now, reading)
    node.arm.learn(reading, now)
    return reading, tau


def play(node, samples, start=1.0):
    """Send samples, the first one at `start` s; return the time of the last one."""
    for t, q, qd, tau in zip(samples.t - samples.t[0] + start, samples.q, samples.qd,
                             samples.tau):
        send_message(node, joint_state(samples.names, float(t), q, qd, tau), float(t))
    return float(samples.t[-1] - samples.t[0] + start)


def refit(node):
    """Request a fit of a `NodeCore`, and wait for it; return the reply."""
    until(node, lambda: node.fits.job is None)
    replies = []
    node.learner.request(FIT, time.monotonic(), lambda *reply: replies.append(reply))
    until(node, lambda: replies)
    return replies[0]


def until(node, condition, seconds=180.0):
    """Call `tick` of a `NodeCore` until a condition is true."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, node.statuses(time.monotonic())
        node.tick(time.monotonic())
        time.sleep(0.002)


def torque(q, mass=1.0):
    """Return the torque in poses (..., 2), N·m."""
    return mass * np.array([5.0, 2.0]) * np.sin(q)


def motion(n, seed=0):
    """Return time (n,) and poses (n, 2) of slow motion."""
    t = 0.2 * np.arange(n)
    return t, np.stack([1.2 * np.sin(0.11 * t + seed), 0.9 * np.cos(0.07 * t + seed)], axis=1)


def slow_state(t, q, tau, names=('a', 'b')):
    """Return a joint state of slow motion."""
    return joint_state(names, t, q, [0.14] * len(q), tau)


def feed(node, n, start=1.0, mass=1.0, seed=0):
    """Send n joint states of slow motion; return the time of the last one."""
    t, q = motion(n, seed)
    tau = torque(q, mass) + 0.01 * np.random.default_rng(7).standard_normal(q.shape)
    for k in range(n):
        send_message(node, slow_state(start + t[k], q[k], tau[k]), start + t[k], 0.0)
    return start + t[-1]


def status(node, name, now=0.0):
    """Return a status of the node by its name."""
    return {each.name: each for each in node.statuses(now)}[name]
