"""
Trajectory files.

- YAML: a trajectory_msgs/JointTrajectory for `ros2 topic pub`, or the goal of a
  FollowJointTrajectory action. Points are 0.1 s apart, with velocities and accelerations, so that
  a controller interpolates by quintic splines. More points would exceed the length of a command
  line.
- MCAP: JointState messages on /planned_joint_states, for display (written only).
"""

from __future__ import annotations

from collections.abc import Sequence
import json
import math
from pathlib import Path

from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.errors import BagError, DataError
from gravity_comp_ros.printable import printable
import numpy as np

ENDINGS = ('.yaml', '.yml', '.mcap')
PLANNED_TOPIC = '/planned_joint_states'

_POINT_STEP = 0.1  # s


def write_trajectory(path: Path, trajectory: Trajectory, comments: Sequence[str] = (),
                     goal: bool = False) -> None:
    """
    Write a trajectory in the format given by the file name's ending.

    :param comments: comment lines at the top of a YAML file.
    :param goal: write YAML as the goal of a FollowJointTrajectory action.
    :raises BagError: if the ending is unknown or the file cannot be written.
    """
    if path.suffix in ('.yaml', '.yml'):
        write_atomically(path, to_yaml(trajectory, comments, goal).encode(), BagError)
    elif path.suffix == '.mcap':
        from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
        write_bag(path, [JointTopic(PLANNED_TOPIC, trajectory.joints, trajectory.t,
                                    trajectory.q, trajectory.qd, trajectory.effort)])
    else:
        raise BagError(f'{path} does not end in {", ".join(ENDINGS)}')


def read_trajectory(path: Path) -> Trajectory:
    """
    Read a trajectory from a YAML file.

    :raises BagError: if the file cannot be read or contains no trajectory.
    """
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'no text'
        raise BagError(f'cannot read the motion {path}: {reason.lower()}') from None
    try:
        return from_yaml(text)
    except (DataError, KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise BagError(f'{path} contains no joint trajectory: {printable(error)}') from None


def to_yaml(trajectory: Trajectory, comments: Sequence[str] = (), goal: bool = False) -> str:
    """Return the trajectory as YAML, one line per point."""
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
    Parse the YAML of a JointTrajectory or of an action goal.

    Missing velocities and accelerations are 0.
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


def _numbers(row: FloatArray) -> str:
    return ', '.join(f'{value:.5f}' for value in row + 0.0)
