"""Two joints that do not load each other: their torque, slow motion, and messages to a node."""

from bench.shared import node_messages
from bench.shared.node_messages import send_message
import numpy as np


def torque(q, mass=1.0):
    """Return the torque in poses (..., 2), N·m."""
    return mass * np.array([5.0, 2.0]) * np.sin(q)


def motion(n, seed=0):
    """Return time (n,) and poses (n, 2) of slow motion."""
    t = 0.2 * np.arange(n)
    return t, np.stack([1.2 * np.sin(0.11 * t + seed), 0.9 * np.cos(0.07 * t + seed)], axis=1)


def joint_state(t, q, tau, names=('a', 'b')):
    """Return a joint state of slow motion."""
    return node_messages.joint_state(names, t, q, [0.14] * len(q), tau)


def feed(node, n, start=1.0, mass=1.0, seed=0):
    """Send n joint states of slow motion; return the time of the last one."""
    t, q = motion(n, seed)
    tau = torque(q, mass) + 0.01 * np.random.default_rng(7).standard_normal(q.shape)
    for k in range(n):
        send_message(node, joint_state(start + t[k], q[k], tau[k]), start + t[k], 0.0)
    return start + t[-1]


def status(node, name, now=0.0):
    """Return a status of the node by its name."""
    return {each.name: each for each in node.statuses(now)}[name]
