"""
A URDF as a tree of joints.

Of each joint only its name, type, links and mimic rule are read at once. Where it lies and its
axis are read when an arm needs them, so that a wheel or a finger with a malformed axis is no
obstacle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.printable import printable
import numpy as np

TURNING = ('revolute', 'continuous')
# Joints with neither one angle nor one length; where they hold a robot they are at rest.
FREE = ('floating', 'planar')
KINDS = (*TURNING, 'prismatic', 'fixed', *FREE)


@dataclass(frozen=True)
class Mimic:
    """The joint that another one follows: value = multiplier * value(joint) + offset."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class TreeJoint:
    """One <joint>: its type, the links that it connects, and its mimic rule if it has one."""

    name: str
    kind: str
    parent: str
    child: str
    element: Element
    source: str

    @property
    def turns(self) -> bool:
        return self.kind in TURNING

    @property
    def moves(self) -> bool:
        return self.kind != 'fixed'

    @property
    def mimic(self) -> Mimic | None:
        found = _child(self.element, 'mimic')
        if found is None:
            return None
        return Mimic(printable(found.get('joint', '')),
                     self._number(found, 'multiplier', 1.0), self._number(found, 'offset', 0.0))

    def origin(self) -> FloatArray:
        """Return where the joint lies in its parent link, (3,) in m."""
        return self._vector(_child(self.element, 'origin'), 'xyz', (0.0, 0.0, 0.0))

    def rotation(self) -> FloatArray:
        """Return the rotation of the joint's frame in its parent link, (3, 3)."""
        return _rotation(self._vector(_child(self.element, 'origin'), 'rpy', (0.0, 0.0, 0.0)))

    def axis(self) -> FloatArray:
        """Return the unit vector (3,) of the axis in the joint's frame."""
        axis = self._vector(_child(self.element, 'axis'), 'xyz', (1.0, 0.0, 0.0))
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            raise DataError(f'{self.source}: the axis of {self.kind} joint {self.name} has no '
                            f'direction')
        return axis / length

    def limits(self) -> tuple[float, float] | None:
        """Return the lower and upper limit of the position; None for a joint without limits."""
        limit = _child(self.element, 'limit')
        if limit is None or self.kind == 'continuous':
            return None
        low, high = self._number(limit, 'lower', 0.0), self._number(limit, 'upper', 0.0)
        return (low, high) if low <= high else None

    def rest(self) -> float:
        """Return 0, or the middle of the limits if 0 lies beyond them."""
        low, high = self.limits() or (0.0, 0.0)
        return 0.0 if low <= 0.0 <= high else 0.5 * (low + high)

    def _number(self, element: Element, key: str, default: float) -> float:
        text = element.get(key)
        try:
            value = default if text is None else float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise DataError(f'{self.source}: joint {self.name} has {key}='
                            f'"{printable(str(text))}", not a number')
        return value

    def _vector(self, element: Element | None, key: str,
                default: tuple[float, float, float]) -> FloatArray:
        text = None if element is None else element.get(key)
        if text is None:
            return np.array(default)
        try:
            vector = np.array([float(part) for part in text.split()])
        except ValueError:
            vector = np.zeros(0)
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise DataError(f'{self.source}: joint {self.name} has {key}="{printable(text)}", '
                            f'not 3 numbers')
        return vector


@dataclass(frozen=True)
class RobotTree:
    """All joints of a robot by name, and by the link that they move."""

    joints: dict[str, TreeJoint]
    moving: dict[str, TreeJoint]
    source: str

    def path(self, name: str) -> list[TreeJoint]:
        """
        Return all joints from the root to the named one, fixed ones included.

        :raises DataError: if the way up from it never ends.
        """
        way = [self.joints[name]]
        while way[-1].parent in self.moving:
            way.append(self.moving[way[-1].parent])
            if len(way) > len(self.moving):
                raise DataError(f'{self.source}: joint {name} is among its own parents')
        return way[::-1]


def parse_tree(text: str | bytes, source: str) -> RobotTree:
    """
    Return the joints of a URDF's text.

    :param source: what to call it in messages.
    :raises DataError: if it is no URDF, or a xacro file.
    """
    try:
        root = fromstring(_trimmed(text))
    except (ParseError, DefusedXmlException, ValueError, RecursionError) as problem:
        raise DataError(f'{source} is not a URDF: {printable(str(problem))}') from problem
    if _local(root) != 'robot':
        raise DataError(f'{source} is not a URDF: it holds <{printable(root.tag)}>, not <robot>')
    _refuse_xacro(root, source)
    every = [_joint(element, source) for element in root if _local(element) == 'joint']
    joints: dict[str, TreeJoint] = {}
    moving: dict[str, TreeJoint] = {}
    for joint in every:
        if joint.name in joints:
            raise DataError(f'{source}: two joints are named {joint.name}')
        if joint.child in moving:
            raise DataError(f'{source}: link {joint.child} has two parents, joints '
                            f'{moving[joint.child].name} and {joint.name}')
        joints[joint.name] = moving[joint.child] = joint
    return RobotTree(joints, moving, source)


def position_limits(text: str | bytes, joints: Sequence[str],
                    source: str = 'URDF') -> tuple[FloatArray, FloatArray]:
    """
    Return the lower and upper limits (N,) in rad; a turn either way for a continuous joint.

    :raises DataError: if the text is no URDF.
    :raises ModelMismatchError: if a joint is not in it.
    """
    tree = parse_tree(text, source)
    missing = [name for name in joints if name not in tree.joints]
    if missing:
        raise ModelMismatchError(f'{source} has no joint {", ".join(missing)}')
    limits = [tree.joints[name].limits() or (-math.pi, math.pi) for name in joints]
    low, high = np.array(limits, dtype=np.float64).T
    return low, high


def _trimmed(text: str | bytes) -> str | bytes:
    """Drop what often precedes `<?xml`, where XML allows nothing: a blank line, a BOM."""
    return text.lstrip('\ufeff \t\r\n') if isinstance(text, str) else text.lstrip(b' \t\r\n')


def _refuse_xacro(root: Element, source: str) -> None:
    joints = [part for element in root if _local(element) == 'joint' for part in element.iter()]
    unexpanded = any('${' in value or '$(' in value
                     for part in joints for value in part.attrib.values())
    # An expanded file may still name xacro's namespace; only its elements are left to expand.
    if unexpanded or any('xacro' in str(element.tag) for element in root.iter()):
        raise DataError(f'{source} is a xacro file: turn it into a URDF first '
                        f'(`xacro {source} > robot.urdf`)')


def _joint(element: Element, source: str) -> TreeJoint:
    name = printable(element.get('name', ''))
    parent, child = _child(element, 'parent'), _child(element, 'child')
    if parent is None or child is None:
        raise DataError(f'{source}: joint {name} has no parent or no child')
    kind = printable(element.get('type', ''))
    if kind not in KINDS:
        raise DataError(f'{source}: joint {name} has type "{kind}", which is none of '
                        f'{", ".join(KINDS)}')
    return TreeJoint(name, kind, printable(parent.get('link', '')),
                     printable(child.get('link', '')), element, source)


def _child(element: Element, tag: str) -> Element | None:
    return next((child for child in element if _local(child) == tag), None)


def _local(element: Element) -> str:
    """Return the tag without its namespace: some exporters write one."""
    return str(element.tag).rpartition('}')[2]


def _rotation(rpy: FloatArray) -> FloatArray:
    """Return the rotation by roll about x, pitch about y, yaw about z, in this order."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array([[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                     [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                     [-sp, cp * sr, cp * cr]])
