"""
Read from a URDF where the axes of an arm are: nothing else in it is used.

Masses and meshes are not looked at; fixed joints are merged into their neighbours. The joints
that a model or a recording names must follow each other on one way through the tree; what hangs
beyond the last of them (a gripper) does not matter.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.models.kinematic.chain import aligned
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.printable import printable
import numpy as np

_MAX_BYTES = 32 * 2 ** 20
_TURNING = ('revolute', 'continuous')


@dataclass(frozen=True)
class _Joint:
    name: str
    kind: str
    parent: str
    child: str
    rotation: FloatArray
    origin: FloatArray
    axis: FloatArray


def read_urdf(path: Path | str, joints: Collection[str]) -> Geometry:
    """
    Return where the axes of `joints` are, in the order in which they follow each other.

    :raises DataError: if the file cannot be read or is no URDF.
    :raises ModelMismatchError: if it is of another arm.
    """
    path = Path(path)
    try:
        with path.open('rb') as stream:
            data = stream.read(_MAX_BYTES + 1)
    except OSError as problem:
        reason = (problem.strerror or 'unreadable').lower()
        raise DataError(f'cannot read URDF {path}: {reason}') from problem
    if len(data) > _MAX_BYTES:
        raise DataError(f'{path} is too large to be a URDF')
    return parse_urdf(data, joints, str(path))


def parse_urdf(text: str | bytes, joints: Collection[str], source: str = 'URDF') -> Geometry:
    """
    Return the same from a URDF's text, such as what /robot_description holds.

    :param source: what to call it in messages.
    :raises DataError: if it is no URDF.
    :raises ModelMismatchError: if it is of another arm.
    """
    try:
        root = fromstring(text)
    except (ParseError, DefusedXmlException, ValueError, RecursionError) as problem:
        raise DataError(f'{source} is not a URDF: {printable(str(problem))}') from problem
    if root.tag != 'robot':
        raise DataError(f'{source} is not a URDF: it holds <{printable(root.tag)}>, not <robot>')
    if any('xacro' in element.tag for element in root):
        raise DataError(f'{source} is a xacro file: turn it into a URDF first '
                        f'(`xacro {source} > robot.urdf`)')
    every = [_joint(element, source) for element in root.iter('joint')
             if element.get('type') is not None]
    return _geometry(_path(every, set(joints), source), source)


def _path(every: list[_Joint], wanted: set[str], source: str) -> list[_Joint]:
    """Return all joints from the root to the last one wanted, fixed ones among them."""
    by_name = {joint.name: joint for joint in every}
    missing = sorted(wanted - set(by_name))
    if missing or not wanted:
        known = ', '.join(joint.name for joint in every if joint.kind != 'fixed')
        raise ModelMismatchError(f'{source} has no joint {", ".join(missing)}; it has {known}')
    above = {joint.child: joint for joint in every}
    ways = [_upwards(by_name[name], above, source) for name in wanted]
    longest = max(ways, key=len)
    passed = [joint.name for joint in longest if joint.kind != 'fixed']
    aside = sorted(wanted - set(passed))
    if aside:
        raise ModelMismatchError(f'{source}: {", ".join(aside)} and {longest[-1].name} are on '
                                 f'different branches; name the joints of one arm (--joints)')
    between = [name for name in passed if name not in wanted]
    if between:
        raise ModelMismatchError(f'{source} has joint {", ".join(between)} before '
                                 f'{longest[-1].name}, which the samples lack')
    return longest


def _upwards(joint: _Joint, above: dict[str, _Joint], source: str) -> list[_Joint]:
    way = [joint]
    while way[-1].parent in above:
        way.append(above[way[-1].parent])
        if len(way) > len(above):
            raise DataError(f'{source}: joint {joint.name} hangs on itself')
    return way[::-1]


def _geometry(way: list[_Joint], source: str) -> Geometry:
    names, rotations, origins = [], [], []
    # The frame of the next link in that of the last axis.
    rotation, origin = np.eye(3), np.zeros(3)
    for joint in way:
        origin = origin + rotation @ joint.origin
        rotation = rotation @ joint.rotation
        if joint.kind == 'fixed':
            continue
        if joint.kind not in _TURNING:
            raise ModelMismatchError(f'{source}: joint {joint.name} is {joint.kind}; only '
                                     f'revolute joints are possible')
        turn = aligned(joint.axis)
        names.append(joint.name)
        rotations.append(rotation @ turn)
        origins.append(origin)
        rotation, origin = turn.T, np.zeros(3)
    return Geometry(tuple(names), np.array(rotations), np.array(origins), way[-1].child, rotation)


def _joint(element: Element, source: str) -> _Joint:
    name = printable(element.get('name', ''))
    parent, child = element.find('parent'), element.find('child')
    if parent is None or child is None:
        raise DataError(f'{source}: joint {name} has no parent or no child')
    place = element.find('origin')
    axis = element.find('axis')
    along = _vector(axis, 'xyz', (1.0, 0.0, 0.0), name, source)
    length = float(np.linalg.norm(along))
    if length < 1e-9:
        raise DataError(f'{source}: the axis of joint {name} has no direction')
    return _Joint(name, element.get('type', ''), printable(parent.get('link', '')),
                  printable(child.get('link', '')),
                  _rotation(_vector(place, 'rpy', (0.0, 0.0, 0.0), name, source)),
                  _vector(place, 'xyz', (0.0, 0.0, 0.0), name, source), along / length)


def _vector(element: Element | None, key: str, default: tuple[float, float, float], name: str,
            source: str) -> FloatArray:
    text = None if element is None else element.get(key)
    if text is None:
        return np.array(default)
    try:
        vector = np.array([float(part) for part in text.split()])
    except ValueError:
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise DataError(f'{source}: joint {name} has {key}="{printable(text)}", not 3 numbers')
    return vector


def _rotation(rpy: FloatArray) -> FloatArray:
    """Return the rotation by roll about x, pitch about y, yaw about z, in this order."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array([[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                     [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                     [-sp, cp * sr, cp * cr]])
