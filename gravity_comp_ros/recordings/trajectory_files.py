"""
Trajectories to files that people can play, and back.

- YAML: a trajectory_msgs/JointTrajectory as `ros2 topic pub` takes it, or the goal of a
  FollowJointTrajectory action. Its points are 0.1 s apart, with velocities and accelerations, so
  that a controller interpolates them by quintic splines; more points would not fit into an
  argument of a command.
- CSV: a column for the time and one for each joint's position, speed, acceleration and effort.
- MCAP: the motion as JointState on /planned_joint_states, to look at.
"""

from __future__ import annotations

from collections.abc import Sequence
import csv
import io
import json
import math
from pathlib import Path

from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.errors import BagError, DataError
from gravity_comp_ros.printable import printable
import numpy as np

ENDINGS = ('.yaml', '.yml', '.csv', '.mcap')
PLANNED_TOPIC = '/planned_joint_states'

_POINT_STEP = 0.1
_PREFIXES = (('q', 'q_'), ('qd', 'qd_'), ('qdd', 'qdd_'), ('effort', 'effort_'))


def write_trajectory(path: Path, trajectory: Trajectory, comments: Sequence[str] = (),
                     goal: bool = False) -> None:
    """
    Write a trajectory in the format that the name's ending says.

    :param comments: lines for the head of a YAML file.
    :param goal: write YAML as the goal of a FollowJointTrajectory action.
    :raises BagError: if the ending is unknown or the file cannot be written.
    """
    if path.suffix in ('.yaml', '.yml'):
        write_atomically(path, to_yaml(trajectory, comments, goal).encode(), BagError)
    elif path.suffix == '.csv':
        write_atomically(path, to_csv(trajectory).encode(), BagError)
    elif path.suffix == '.mcap':
        from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
        write_bag(path, [JointTopic(PLANNED_TOPIC, trajectory.joints, trajectory.t,
                                    trajectory.q, trajectory.qd, trajectory.effort)])
    else:
        raise BagError(f'{path} does not end in {", ".join(ENDINGS)}')


def read_trajectory(path: Path) -> Trajectory:
    """
    Return the trajectory in a YAML or CSV file.

    :raises BagError: if the file cannot be read or holds none.
    """
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'no text'
        raise BagError(f'cannot read the motion {path}: {reason.lower()}') from None
    try:
        return from_csv(text) if path.suffix == '.csv' else from_yaml(text)
    except (DataError, KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise BagError(f'{path} holds no joint trajectory: {printable(error)}') from None


def to_yaml(trajectory: Trajectory, comments: Sequence[str] = (), goal: bool = False) -> str:
    """Return the message as YAML, one point a line."""
    lines = [f'# {printable(line)}' for line in comments]
    indent = '  ' if goal else ''
    if goal:
        lines.append('trajectory:')
    names = ', '.join(json.dumps(name, ensure_ascii=False) for name in trajectory.joints)
    lines += [f'{indent}joint_names: [{names}]', f'{indent}points:']
    count = max(1, math.ceil(trajectory.duration / _POINT_STEP - 1e-9))
    times = np.linspace(trajectory.t[0], trajectory.t[-1], count + 1)
    efforts = None if trajectory.effort is None else np.column_stack(
        [np.interp(times, trajectory.t, column) for column in trajectory.effort.T])
    for k, (t, q, qd, qdd) in enumerate(zip(times, *trajectory.at(times))):
        parts = [('positions', q), ('velocities', qd), ('accelerations', qdd)]
        if efforts is not None:
            parts.append(('effort', efforts[k]))
        seconds, nanoseconds = divmod(round(float(t - trajectory.t[0]) * 1e9), 10 ** 9)
        values = ', '.join(f'{name}: [{_numbers(row)}]' for name, row in parts)
        lines.append(f'{indent}- {{{values}, time_from_start: {{sec: {seconds}, nanosec: '
                     f'{nanoseconds}}}}}')
    return '\n'.join(lines) + '\n'


def from_yaml(text: str) -> Trajectory:
    """
    Return the trajectory of a JointTrajectory or an action goal.

    Velocities and accelerations that are missing count as 0.
    """
    import yaml
    try:
        content = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError) as error:
        raise ValueError(printable(error)) from None
    message = content.get('trajectory', content)
    points = message['points']
    times = [float(p['time_from_start'].get('sec', 0))
             + 1e-9 * float(p['time_from_start'].get('nanosec', 0)) for p in points]
    q = np.array([p['positions'] for p in points], dtype=np.float64)
    qd, qdd = (np.array([p.get(name) or [0.0] * q.shape[1] for p in points], dtype=np.float64)
               for name in ('velocities', 'accelerations'))
    effort = (np.array([p['effort'] for p in points], dtype=np.float64)
              if all(p.get('effort') for p in points) else None)
    return Trajectory(tuple(map(str, message['joint_names'])), np.array(times), q, qd, qdd,
                      effort)


def to_csv(trajectory: Trajectory) -> str:
    """Return a table with a header."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    parts = [(prefix, getattr(trajectory, name)) for name, prefix in _PREFIXES
             if getattr(trajectory, name) is not None]
    writer.writerow(['t', *(prefix + joint for prefix, _ in parts for joint in trajectory.joints)])
    rows = np.column_stack([trajectory.t, *(values for _, values in parts)])
    writer.writerows([f'{value:.9g}' for value in row] for row in rows)
    return stream.getvalue()


def from_csv(text: str) -> Trajectory:
    """Return the trajectory of a table with columns t, q_JOINT, qd_JOINT and qdd_JOINT."""
    header, *rows = csv.reader(io.StringIO(text))
    values = np.array(rows, dtype=np.float64)
    joints = tuple(name[2:] for name in header if name.startswith('q_'))
    found: dict[str, FloatArray] = {}
    for name, prefix in _PREFIXES:
        if all(prefix + joint in header for joint in joints):
            found[name] = values[:, [header.index(prefix + joint) for joint in joints]]
    if not joints or 't' not in header:
        raise ValueError('it has no columns t and q_JOINT')
    still = np.zeros_like(found['q'])
    return Trajectory(joints, values[:, header.index('t')], found['q'], found.get('qd', still),
                      found.get('qdd', still), found.get('effort'))


def _numbers(row: FloatArray) -> str:
    return ', '.join(f'{value:.5f}' for value in row + 0.0)
