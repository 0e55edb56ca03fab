"""Test recordings: a synthetic motion, and rosbag2 folders written by rosbags."""

from __future__ import annotations

from pathlib import Path

from gravity_comp_ros.recordings.joint_state_cdr import encode, JOINT_STATE
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import get_typestore, Stores

STORE = get_typestore(Stores.ROS2_JAZZY)
START_NS = 1_700_000_000 * 10**9
NAMES = ('shoulder', 'elbow', 'wrist')


def motion(count=50, rate=50.0):
    """Return t (M,), q, qd and tau (M, 3) of a synthetic arm."""
    t = np.arange(count) / rate
    phase = t[:, None] + np.array([0.0, 1.0, 2.0])
    return t, np.sin(phase), np.cos(phase), 10 * np.cos(np.sin(phase))


def messages(count=50, rate=50.0, names=NAMES):
    """Return [log time in ns, keyword arguments of `encode`] of each sample of `motion`."""
    t, q, qd, tau = motion(count, rate)
    stamps = START_NS + np.round(t * 1e9).astype(int)
    return [[int(ns), {'stamp_ns': int(ns), 'names': list(names), 'position': list(a),
                       'velocity': list(b), 'effort': list(c)}]
            for ns, a, b, c in zip(stamps, q, qd, tau)]


def check_motion(recording) -> None:
    """Check that a recording is `motion`."""
    samples, (t, *values) = recording.samples, motion()
    assert samples.names == NAMES
    np.testing.assert_allclose(samples.t, t, atol=1e-9)
    for field, expected in zip(('q', 'qd', 'tau'), values):
        np.testing.assert_array_equal(getattr(samples, field), expected)


def write_folder(path: Path, topics, plugin='sqlite3', version=8, compression=None) -> Path:
    """
    Write a rosbag2 folder.

    :param topics: topic name -> list of [log time, keyword arguments of `encode` or bytes].
    """
    storage = StoragePlugin.MCAP if plugin == 'mcap' else StoragePlugin.SQLITE3
    writer = Writer(path, version=version, storage_plugin=storage)
    if compression:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        for name, rows in topics.items():
            connection = writer.add_connection(name, JOINT_STATE, typestore=STORE)
            for log_ns, content in rows:
                raw = content if isinstance(content, bytes) else encode(**content)
                writer.write(connection, log_ns, raw)
    return path


def add_other_topic(path: Path, type_name='std_msgs/msg/String') -> Path:
    """Write a rosbag2 folder with one topic of another type."""
    with Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection('/chatter', type_name, typestore=STORE)
        String = STORE.types[type_name]
        writer.write(connection, START_NS, STORE.serialize_cdr(String(data='x'), type_name))
    return path
