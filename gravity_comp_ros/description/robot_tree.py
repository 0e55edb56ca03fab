"""
Robot descriptions: joint tree of a URDF, from a file or a recording.

Parsing reads the name, type and links of each joint. Origin, axis, limits and mimic rule are read
on demand, so that a malformed wheel or finger does not affect the arm.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
import math
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring
from gravity_comp_ros.data.samples import FloatArray, rename_hint
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.models.kinematic.chain import about
from gravity_comp_ros.printable import printable, shown_names
import numpy as np

REVOLUTE = ('revolute', 'continuous')
# Joints with several degrees of freedom; taken at their zero position.
FREE = ('floating', 'planar')
KINDS = (*REVOLUTE, 'prismatic', 'fixed', *FREE)
_MAX_NAMES = 16
_MAX_BYTES = 32 * 2 ** 20


@dataclass(frozen=True)
class Mimic:
    """Mimic rule of a joint: value = multiplier * value(joint) + offset."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class TreeJoint:
    """One <joint> of a URDF."""

    name: str
    kind: str
    parent: str
    child: str
    element: Element
    source: str

    @property
    def revolute(self) -> bool:
        return self.kind in REVOLUTE

    @property
    def moves(self) -> bool:
        return self.kind != 'fixed'

    @property
    def is_single(self) -> bool:
        """Return whether the joint has one degree of freedom."""
        return self.moves and self.kind not in FREE

    @property
    def mimic(self) -> Mimic | None:
        rule = self.element.find('mimic')
        if rule is None:
            return None
        multiplier, offset = (float(self._numbers('mimic', *value)[0]) for value in (
            ('multiplier', '1'), ('offset', '0')))
        return Mimic(printable(rule.get('joint', '')), multiplier, offset)

    def origin(self) -> FloatArray:
        """Return the position of the joint frame in the parent link, (3,) in m."""
        return self._numbers('origin', 'xyz', '0 0 0')

    def rotation(self) -> FloatArray:
        """Return the rotation (3, 3) of the joint frame in the parent link."""
        return rotation_of(self._numbers('origin', 'rpy', '0 0 0'))

    def axis(self) -> FloatArray:
        """Return the unit vector (3,) of the axis in the joint frame."""
        axis = self._numbers('axis', 'xyz', '1 0 0')
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            raise DataError(f'{self.source}: the axis of {self.kind} joint {self.name} has no '
                            f'direction')
        return axis / length

    def limits(self) -> tuple[float, float] | None:
        """Return the lower and upper position limit, rad or m; None for a joint without limits."""
        if self.element.find('limit') is None or self.kind == 'continuous':
            return None
        low, high = (float(self._numbers('limit', key, '0')[0]) for key in ('lower', 'upper'))
        return (low, high) if low <= high else None

    def rest(self) -> float:
        """Return the assumed position: 0, or the middle of the limits if they exclude 0."""
        low, high = self.limits() or (0.0, 0.0)
        return 0.0 if low <= 0.0 <= high else 0.5 * (low + high)

    def _numbers(self, tag: str, key: str, default: str) -> FloatArray:
        return numbers_of(self.element.find(tag), key, default,
                          f'{self.source}: joint {self.name}')


@dataclass(frozen=True)
class RobotTree:
    """
    All joints of a robot, by name (`joints`) and by child link (`by_child`), in XML `root`.

    `source` is the name of the description in messages, `folder` that of its file, if it is one.
    """

    joints: dict[str, TreeJoint]
    by_child: dict[str, TreeJoint]
    source: str
    root: Element
    text: str | bytes
    folder: Path | None = None

    def path(self, name: str) -> list[TreeJoint]:
        """
        Return all joints from the root to the named one, including fixed ones.

        :raises DataError: if the joints form a cycle.
        """
        path = [self.joints[name]]
        while path[-1].parent in self.by_child:
            path.append(self.by_child[path[-1].parent])
            if len(path) > len(self.by_child):
                raise DataError(f'{self.source}: joint {name} is among its own parents')
        return path[::-1]

    def position_limits(self, joints: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """
        Return the lower and upper position limits (N,) in rad; -π and π for joints without limits.

        :raises ModelMismatchError: if a joint is missing.
        """
        self._check_known(joints)
        limits = [self.joints[name].limits() or (-math.pi, math.pi) for name in joints]
        low, high = np.array(limits, dtype=np.float64).T
        return low, high

    def arm_joints(self, recorded: Sequence[str]) -> tuple[tuple[str, ...], dict[str, str]]:
        """
        Return the serial arm among recorded joints, from the base outwards, and the other joints.

        Prismatic joints and mimic joints are left out, with the reason, because the gravity model
        requires independent revolute joints.

        :raises ModelMismatchError: if a joint is missing, or the joints are on several arms.
        """
        self._check_known(recorded)
        left_out = {name: reason for name in recorded
                    if (reason := _exclusion(self.joints[name]))}
        selected = [name for name in recorded if name not in left_out]
        path = self.arm_path(selected)
        return tuple(joint.name for joint in path if joint.name in selected), left_out

    def arm_path(self, joints: Collection[str]) -> list[TreeJoint]:
        """
        Return all joints from the root to the last of these joints, including fixed ones.

        :raises ModelMismatchError: if the joints are not on one path, or one is not an independent
            revolute joint.
        """
        self._check_known(joints)
        for name in joints:
            reason = _exclusion(self.joints[name])
            if reason:
                raise ModelMismatchError(f'{self.source}: joint {name} {reason}; leave it out '
                                         f'(--joints)')
        paths = {name: self.path(name) for name in joints}
        longest = max(paths.values(), key=len)
        if not set(joints) <= {joint.name for joint in longest}:
            raise ModelMismatchError(_several_arms(self.source, paths))
        return longest

    def _check_known(self, joints: Collection[str]) -> None:
        missing = sorted(set(joints) - set(self.joints))
        if missing or not joints:
            known = [joint.name for joint in self.joints.values() if joint.moves]
            revolute = [name for name in known if self.joints[name].revolute]
            raise ModelMismatchError(f'{self.source} has no joint {", ".join(missing)}; it has '
                                     f'{shown_names(known, _MAX_NAMES)}'
                                     f'{rename_hint(revolute, [*joints], to_known=True)}')


def read_text(path: Path | str, kind: str = 'URDF') -> bytes:
    """
    Return the content of a robot description.

    :param kind: format of the file, for messages.
    :raises DataError: if it cannot be read or is too large.
    """
    path = Path(path)
    try:
        with path.open('rb') as stream:
            data = stream.read(_MAX_BYTES + 1)
    except OSError as problem:
        reason = (problem.strerror or 'unreadable').lower()
        raise DataError(f'cannot read {kind} {path}: {reason}') from problem
    if len(data) > _MAX_BYTES:
        raise DataError(f'{path} is too large to be a robot description')
    return data


def find_description(urdf: Path | str | None,
                     recordings: Collection[Path | str]) -> RobotTree | None:
    """
    Return the description in a file, without one that of the first recording which has one.

    :raises DataError: if the file cannot be read, or the description is not a URDF.
    :raises BagError: if a recording cannot be read, or its description is damaged.
    """
    if urdf is not None:
        return parse_tree(read_text(urdf), str(urdf), Path(urdf).resolve().parent)
    for recording in recordings:
        # Imports file-format libraries, which arrays do not need.
        from gravity_comp_ros.recordings.bag import robot_description
        recorded = robot_description(recording)
        if recorded is not None:
            return parse_tree(recorded.text, recorded.source)
    return None


def parse_tree(text: str | bytes, source: str = 'URDF', folder: Path | None = None) -> RobotTree:
    """
    Parse the text of a URDF.

    :param source: name of the description in messages.
    :param folder: that of its file.
    :raises DataError: if the text is not a URDF, or is a xacro file.
    """
    try:
        root = fromstring(_trimmed(text))
    except (ParseError, DefusedXmlException, ValueError, RecursionError) as problem:
        raise DataError(f'{source} is not a URDF: {printable(str(problem))}') from problem
    has_xacro = any('xacro' in element.tag for element in root.iter())
    for element in root.iter():
        # Some exporters write a namespace. That of xacro alone may be left in expanded files.
        element.tag = element.tag.rpartition('}')[2]
    if root.tag != 'robot':
        raise DataError(f'{source} is not a URDF: its root is <{printable(root.tag)}>, not '
                        f'<robot>; name the URDF of this arm')
    values = [value for path in ('joint', 'link/inertial') for element in root.iterfind(path)
              for part in element.iter() for value in part.attrib.values()]
    if has_xacro or any('${' in value or '$(' in value for value in values):
        raise DataError(f'{source} is a xacro file: convert it to a URDF first '
                        f'(`xacro {source} > robot.urdf`)')
    parsed = [_joint(element, source) for element in root.iterfind('joint')]
    joints: dict[str, TreeJoint] = {}
    by_child: dict[str, TreeJoint] = {}
    for joint in parsed:
        if joint.name in joints:
            raise DataError(f'{source}: two joints are named {joint.name}')
        if joint.child in by_child:
            raise DataError(f'{source}: link {joint.child} has two parents, joints '
                            f'{by_child[joint.child].name} and {joint.name}')
        joints[joint.name] = by_child[joint.child] = joint
    return RobotTree(joints, by_child, source, root, text, folder)


def _trimmed(text: str | bytes) -> str | bytes:
    """Remove a blank line or BOM before `<?xml`, which XML does not allow."""
    return text.lstrip('\ufeff \t\r\n') if isinstance(text, str) else text.lstrip(b' \t\r\n')


def _joint(element: Element, source: str) -> TreeJoint:
    name = printable(element.get('name', ''))
    parent, child = element.find('parent'), element.find('child')
    if parent is None or child is None:
        raise DataError(f'{source}: joint {name} has no parent or no child')
    kind = printable(element.get('type', ''))
    if kind not in KINDS:
        raise DataError(f'{source}: joint {name} has type "{kind}", which is none of '
                        f'{", ".join(KINDS)}')
    return TreeJoint(name, kind, printable(parent.get('link', '')),
                     printable(child.get('link', '')), element, source)


def numbers_of(element: Element | None, key: str, default: str, where: str) -> FloatArray:
    """
    Return the numbers of an attribute, as many as those of the default.

    :param element: None for the default.
    :param where: subject of the error.
    :raises DataError: if it has others than finite numbers, or another number of them.
    """
    text = default if element is None else element.get(key, default)
    try:
        values = np.array([float(part) for part in text.split()])
    except ValueError:
        values = np.zeros(0)
    count = len(default.split())
    if len(values) != count or not np.isfinite(values).all():
        raise DataError(f'{where} has {key}="{printable(text)}", not '
                        f'{"a number" if count == 1 else f"{count} numbers"}')
    return values


def rotation_of(rpy: FloatArray) -> FloatArray:
    """Return the rotation matrix of roll about x, pitch about y, yaw about z, in this order."""
    x, y, z = (about(axis, float(angle)) for axis, angle in zip(np.eye(3), rpy))
    return z @ y @ x


def _exclusion(joint: TreeJoint) -> str:
    """Return the reason why a joint cannot be part of an arm; '' if it can."""
    if not joint.revolute:
        return f'is {joint.kind}: only revolute joints are supported'
    if joint.mimic is not None:
        return f'mimics {joint.mimic.joint}'
    return ''


def _several_arms(source: str, paths: dict[str, list[TreeJoint]]) -> str:
    """Return the error message for joints on several branches, with the joints of each branch."""
    branches: list[list[str]] = []
    for path in sorted(paths.values(), key=len, reverse=True):
        names = [joint.name for joint in path if joint.name in paths]
        if not any(set(names) <= set(branch) for branch in branches):
            branches.append(names)
    listed = ' | '.join(shown_names(branch, _MAX_NAMES) for branch in branches)
    return (f'{source}: the joints are on {len(branches)} different branches: {listed}; choose '
            f'those of one arm (--joints {",".join(branches[0])})')
