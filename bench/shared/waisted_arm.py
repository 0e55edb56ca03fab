"""Recordings of the iiwa with a robot description: alone, and on a waist that pitches."""

from pathlib import Path

from bench.shared import urdf_snippets as robots
from bench.shared.recordings import START_NS, STORE
from gravity_comp_ros.recordings.joint_state_cdr import encode, JOINT_STATE
from gravity_comp_ros.simulation import arms
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

STRING = 'std_msgs/msg/String'
IIWA = (Path(__file__).resolve().parents[2] / 'bags' / 'iiwa7.urdf').read_text()
JOINTS = arms.iiwa7().joints
# The same arm on a waist that pitches, with a gripper.
WAISTED = IIWA.replace('</robot>', robots.joint(
    'waist', 'world', 'iiwa_link_0', axis='0 1 0', rpy='0 0 0').replace(
        '<link name="iiwa_link_0">', '<link name="unused">') + robots.joint(
            'finger', 'iiwa_link_7', 'tip', 'prismatic') + '</robot>')
WAIST = 0.3


def recording(path, text, arm, q, seed=0, others=(), order=sorted):
    """Write gravity at poses q, joints in the order of `order`, and positions of `others`."""
    tau = arms.gravity_torque(arm, q)
    tau += 0.1 * np.random.default_rng(seed).normal(size=tau.shape)
    names = order(arm.joints)
    columns = [arm.joints.index(name) for name in names]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        states = writer.add_connection('/joint_states', JOINT_STATE, typestore=STORE)
        described = writer.add_connection('/robot_description', STRING, typestore=STORE)
        message = STORE.types[STRING](data=text)
        writer.write(described, START_NS, STORE.serialize_cdr(message, STRING))
        for n, pose in enumerate(q):
            stamp = START_NS + n * 200_000_000
            extra = [(name, position(n)) for name, position in others]
            writer.write(states, stamp, encode(
                stamp, [*names, *(name for name, _ in extra)],
                [*pose[columns], *(value for _, value in extra)],
                np.zeros(len(names) + len(extra)), [*tau[n, columns], *(0.0 for _ in extra)]))
    return path
