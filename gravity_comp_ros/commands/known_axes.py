"""The robot description that a verb works with: a file, the recording's own, or none."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gravity_comp_ros.errors import DataError, GravityCompError, OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry

if TYPE_CHECKING:
    from gravity_comp_ros.description.urdf import HeldAt

# A held joint that moves further than this during the recordings is not at rest, rad or m.
_AT_REST = 0.02
_WHY = {'option': '--fixed', 'recording': 'as recorded', 'assumption': 'assumed'}


@dataclass(frozen=True)
class KnownAxes:
    """
    The axes that a description gives, if there is one of use.

    `asked` says that the user named the file; otherwise it is the recording's own. `text` is the
    description, None if there is none. `left_out` are recorded joints that are no part of the
    arm. `notes` are lines for the user; `problem` says why a recording's description is not used.
    """

    geometry: Geometry | None = None
    text: bytes | str | None = None
    asked: bool = False
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    problem: str = ''

    def to_json(self) -> dict[str, object] | None:
        """Return what a result says about the description, ready for JSON."""
        if self.geometry is None:
            return None
        return {'source': self.geometry.source, 'joints': list(self.geometry.joints),
                'link': self.geometry.link, 'left_out': list(self.left_out),
                'held': {joint.name: {'value': joint.value, 'by': joint.by}
                         for joint in self.geometry.held}}


def urdf_file(args: argparse.Namespace) -> Path | None:
    """Return the file that --urdf names, if it names one."""
    return None if args.urdf in (None, 'none') else Path(args.urdf)


def known_axes(args: argparse.Namespace, joints: Sequence[str], choose: bool = False,
               model: GravityModel | None = None) -> KnownAxes:
    """
    Return the axes of these joints from the description that the arguments ask for.

    A file that the user names must fit. The recording's own description is left aside, with a
    note, if it does not.

    :param choose: leave out recorded joints that are no part of an arm, such as a gripper's.
    :param model: whose axes serve where no description is named and no recording holds one.
    :raises DataError: if the file is no URDF.
    :raises ModelMismatchError: if it is of another arm.
    :raises OptionError: if --fixed has no use.
    """
    if args.urdf == 'none':
        if args.fixed:
            raise OptionError('--fixed needs a robot description, and --urdf is none')
        return KnownAxes()
    file = urdf_file(args)
    if file is not None:
        from gravity_comp_ros.description.urdf import read_text
        return _axes(args, joints, choose, read_text(file), str(file), True)
    from gravity_comp_ros.recordings.robot_description import first_description
    try:
        found = first_description(args.bags)
    except GravityCompError as problem:
        return KnownAxes(problem=f'robot description not used: {problem}')
    if found is None:
        if args.fixed:
            raise OptionError('--fixed needs a robot description: no recording holds one, so '
                              'name a file with --urdf')
        if model is not None and model.geometry is not None:
            return KnownAxes(model.geometry, notes=('axes of the model',))
        return KnownAxes()
    try:
        return _axes(args, joints, choose, found.text, found.source, False)
    except OptionError:
        raise
    except GravityCompError as problem:
        return KnownAxes(problem=f'robot description not used: {problem}')


def _axes(args: argparse.Namespace, joints: Sequence[str], choose: bool, text: str | bytes,
          source: str, asked: bool) -> KnownAxes:
    from gravity_comp_ros.description.serial_arm import arm_joints
    from gravity_comp_ros.description.urdf import parse_urdf
    wanted, left_out = tuple(joints), {}
    if choose:
        arm = arm_joints(text, joints, source)
        wanted, left_out = arm.joints, arm.left_out
    geometry = parse_urdf(text, wanted, source, _held_at(args, text, wanted, source))
    notes = [f'axes from {source}']
    notes += [f'joint {name} is left out: it {reason}' for name, reason in left_out.items()]
    notes += [f'joint {joint.name} of the description is held at {joint.value:.4g} '
              f'({_WHY[joint.by]})' for joint in geometry.held]
    return KnownAxes(geometry, text, asked, tuple(left_out), tuple(notes))


def _held_at(args: argparse.Namespace, text: str | bytes, joints: Sequence[str],
             source: str) -> HeldAt:
    """Return where joints beside the wanted ones stand, by --fixed or in the recordings."""
    from gravity_comp_ros.description.urdf import held_joints, HeldAt
    fixed: dict[str, float] = {}
    for part in args.fixed:
        fixed.update(part)
    open_ones = [name for name in held_joints(text, joints, source) if name not in fixed]
    if not open_ones:
        return HeldAt(fixed)
    from gravity_comp_ros.recordings.joint_positions import joint_positions
    ranges = [joint_positions(path, open_ones, args.topic) for path in args.bags]
    recorded = {}
    for name in open_ones:
        seen = [found[name] for found in ranges if name in found]
        if not seen:
            continue
        span = max(r.high for r in seen) - min(r.low for r in seen)
        if span > _AT_REST:
            raise DataError(f'joint {name} moves by {span:.3g} during the recordings, and it '
                            f'carries the arm: learn it as a joint of the arm (--joints), or '
                            f'name where it stands (--fixed {name}=VALUE)')
        recorded[name] = seen[0].median
    return HeldAt(fixed, recorded)
