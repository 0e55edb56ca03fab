"""Robot descriptions from files and recordings, and the axes of an arm in them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from gravity_comp_ros.description.links import DescribedArm
from gravity_comp_ros.description.robot_tree import HeldPositions, parse_tree
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.kinematic.geometry import Geometry

_MAX_BYTES = 32 * 2 ** 20


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


@dataclass(frozen=True)
class Description:
    """Text of a URDF, its name in messages, and the folder of its file, if it is one."""

    text: str | bytes
    source: str
    folder: Path | None = None


def find_description(urdf: Path | str | None, recordings: Collection[Path | str]
                     ) -> Description | None:
    """
    Return the description in a file, without one that of the first recording which has one.

    :raises DataError: if the file cannot be read.
    :raises BagError: if a recording cannot be read, or its description is damaged.
    """
    if urdf is not None:
        return Description(read_text(urdf), str(urdf), Path(urdf).resolve().parent)
    for recording in recordings:
        # Imports file-format libraries, which arrays do not need.
        from gravity_comp_ros.recordings.bag import robot_description
        recorded = robot_description(recording)
        if recorded is not None:
            return Description(recorded.text, recorded.source)
    return None


def parse_urdf(text: str | bytes, joints: Collection[str], source: str = 'URDF',
               held: HeldPositions = HeldPositions()) -> Geometry:
    """
    Return the axes of `joints`, from the base outwards, from the text of a URDF, without masses.

    :param source: name of the description in messages.
    :raises DataError: if the text is not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    :raises OptionError: if `held.fixed` names a joint of the arm or an unknown joint.
    """
    return DescribedArm(parse_tree(text, source), joints, held).geometry


def held_joints(text: str | bytes, joints: Collection[str],
                source: str = 'URDF') -> tuple[str, ...]:
    """
    Return the other joints whose positions the geometry depends on, from the base outwards.

    :raises DataError: as `parse_urdf`.
    :raises ModelMismatchError: as `parse_urdf`.
    """
    arm = DescribedArm(parse_tree(text, source), joints)
    # The position of a mimic joint is given by the joint that it mimics.
    names = (arm.leader(arm.tree.joints[joint.name]).name for joint in arm.geometry.held)
    return tuple(dict.fromkeys(names))
