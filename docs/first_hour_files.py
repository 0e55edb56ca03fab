"""Table and bag of an arm with three joints, the input of docs/make_first_hour.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

FloatArray = NDArray[np.float64]

JOINTS = ('base', 'shoulder', 'elbow')
# Gravity moments of the two heavy links, Coulomb friction and noise, all in N·m.
_UPPER, _FORE = 12.0, 5.0
_FRICTION = {'base': 0.6, 'elbow': 0.4}
_NOISE = 0.03
_START_NS = 1_760_000_000 * 10 ** 9


def motion(seed: int, rate: float, length: float) -> tuple[FloatArray, ...]:
    """Return times (M,), positions, velocities and torques (M, 3) of a slow motion."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(length * rate)) / rate
    q, qd = np.zeros((2, len(t), 3))
    for joint in range(3):
        for size, omega in zip(rng.uniform(0.2, 0.5, 3), rng.uniform(0.08, 0.22, 3)):
            phase = rng.uniform(0, 2 * np.pi)
            q[:, joint] += size * np.sin(omega * t + phase)
            qd[:, joint] += size * omega * np.cos(omega * t + phase)
    q, qd = 0.7 * q, 0.7 * qd
    both = q[:, 1] + q[:, 2]
    tau = np.column_stack([np.zeros(len(t)), _UPPER * np.sin(q[:, 1]) + _FORE * np.sin(both),
                           _FORE * np.sin(both)])
    for name, size in _FRICTION.items():
        joint = JOINTS.index(name)
        tau[:, joint] += size * np.tanh(qd[:, joint] / 0.003)
    return t, q, qd, tau + _NOISE * rng.normal(size=tau.shape)


def write_table(path: Path) -> str:
    """Write a table in the format of a logger, and return its first two lines."""
    t, q, _, tau = motion(1, 50.0, 120.0)
    rows = np.column_stack([np.round(1000 * t), np.degrees(q), tau])
    names = ['t', *(f'{name}_pos' for name in JOINTS), *(f'{name}_eff' for name in JOINTS)]
    lines = [';'.join(names), *(';'.join(f'{x:.5g}'.replace('.', ',') for x in row)
                                for row in rows)]
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    return '\n'.join(lines[:2])


def write_bag(folder: Path) -> None:
    """Write a rosbag2 folder with an independent writer: sorted joints and a gripper."""
    store = get_typestore(Stores.ROS2_JAZZY)
    state, header, stamp = (store.types[name] for name in (
        'sensor_msgs/msg/JointState', 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'))
    t, q, qd, tau = motion(2, 100.0, 120.0)
    order = [JOINTS.index(name) for name in sorted(JOINTS)]
    names = [*sorted(JOINTS), 'gripper']
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection('/joint_states', state.__msgtype__, typestore=store)
        for k, seconds in enumerate(t):
            ns = _START_NS + int(round(seconds * 1e9))
            values = [np.append(x[k, order], 0.0) for x in (q, qd, 1000 * tau)]
            message = state(header(stamp(ns // 10 ** 9, ns % 10 ** 9), ''), names, *values)
            writer.write(topic, ns, store.serialize_cdr(message, state.__msgtype__))
