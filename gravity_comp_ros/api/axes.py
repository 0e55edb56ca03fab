"""The robot description that a step works with: a file, the recordings' own, or none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from gravity_comp_ros.errors import DataError, GravityCompError, Hint, OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry

if TYPE_CHECKING:
    from gravity_comp_ros.description.urdf import HeldAt
    from gravity_comp_ros.recordings.bag import ReadReport
    from gravity_comp_ros.recordings.robot_description import RecordedDescription

NO_DESCRIPTION = 'none'
# A held joint that moves further than this during the recordings is not at rest, rad or m.
_AT_REST = 0.02
_WHY = {'option': 'as asked', 'recording': 'as recorded', 'assumption': 'assumed'}


@dataclass(frozen=True)
class AxesOptions:
    """
    Where the axes of an arm come from.

    `urdf` is a file, or `none`; None takes what the recordings hold. `fixed` says where joints of
    the description stand that the recordings lack, in rad or m; others stand as recorded, or at 0.

    :raises OptionError: if joints are to stand somewhere in no description.
    """

    urdf: Path | str | None = None
    fixed: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.fixed and self.urdf == NO_DESCRIPTION:
            raise OptionError('fixed joints need a robot description, and none is to be used')

    @property
    def file(self) -> Path | None:
        """Return the file that the user names, if there is one."""
        return None if self.urdf in (None, NO_DESCRIPTION) else Path(self.urdf)


@dataclass(frozen=True)
class KnownAxes:
    """
    The axes that a description gives, if there is one of use.

    `asked` says that the user named the file; otherwise it is the recording's own. `left_out` are
    recorded joints that are no part of the arm. `notes` are lines for the user; `problem` says
    why a recording's description is not used.
    """

    geometry: Geometry | None = None
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


def known_axes(reports: Sequence[ReadReport], joints: Sequence[str],
               options: AxesOptions = AxesOptions(), choose: bool = False,
               model: GravityModel | None = None) -> KnownAxes:
    """
    Return the axes of these joints from the description that the options ask for.

    A file that the user names must fit. The recordings' own description is left aside, with
    `problem`, if it does not.

    :param reports: of the recordings; the first one that holds a description gives it.
    :param choose: leave out recorded joints that are no part of an arm, such as a gripper's.
    :param model: whose axes serve where no description is named and no recording holds one.
    :raises DataError: if the file is no URDF.
    :raises ModelMismatchError: if it is of another arm.
    :raises OptionError: if fixed joints are named and there is no description.
    """
    if options.urdf == NO_DESCRIPTION:
        return KnownAxes()
    if options.file is not None:
        from gravity_comp_ros.description.urdf import read_text
        return _axes(reports, joints, options, choose, read_text(options.file), str(options.file))
    try:
        found = _recorded(reports)
        if found is not None:
            return _axes(reports, joints, options, choose, found.text, found.source)
    except OptionError:
        raise
    except GravityCompError as problem:
        return KnownAxes(problem=f'robot description not used: {problem}')
    if options.fixed:
        raise OptionError('fixed joints need a robot description: no recording holds one',
                          Hint.NAME_DESCRIPTION)
    if model is not None and model.geometry is not None:
        return KnownAxes(model.geometry, notes=('axes of the model',))
    return KnownAxes()


def _recorded(reports: Sequence[ReadReport]) -> RecordedDescription | None:
    if not reports:
        return None
    # Needs the libraries of file formats, which arrays do without.
    from gravity_comp_ros.recordings.robot_description import first_description
    return first_description(report.path for report in reports)


def _axes(reports: Sequence[ReadReport], joints: Sequence[str], options: AxesOptions,
          choose: bool, text: str | bytes, source: str) -> KnownAxes:
    # Only this needs the XML parser.
    from gravity_comp_ros.description.serial_arm import arm_joints
    from gravity_comp_ros.description.urdf import parse_urdf
    wanted, left_out = tuple(joints), {}
    if choose:
        arm = arm_joints(text, joints, source)
        wanted, left_out = arm.joints, arm.left_out
    held = _held_at(reports, options.fixed, text, wanted, source)
    geometry = parse_urdf(text, wanted, source, held)
    notes = [f'axes from {source}']
    notes += [f'joint {name} is left out: it {reason}' for name, reason in left_out.items()]
    notes += [f'joint {joint.name} of the description is held at {joint.value:.4g} '
              f'({_WHY[joint.by]})' for joint in geometry.held]
    return KnownAxes(geometry, options.file is not None, tuple(left_out), tuple(notes))


def _held_at(reports: Sequence[ReadReport], fixed: Mapping[str, float], text: str | bytes,
             joints: Sequence[str], source: str) -> HeldAt:
    """Return where joints beside the wanted ones stand, as asked or in the recordings."""
    from gravity_comp_ros.description.urdf import held_joints, HeldAt
    open_ones = [name for name in held_joints(text, joints, source) if name not in fixed]
    if not open_ones:
        return HeldAt(fixed)
    from gravity_comp_ros.recordings.bag import joint_positions
    ranges = [joint_positions(report.path, open_ones, report.topic) for report in reports]
    recorded = {}
    for name in open_ones:
        seen = [found[name] for found in ranges if name in found]
        if not seen:
            continue
        span = max(r.high for r in seen) - min(r.low for r in seen)
        if span > _AT_REST:
            raise DataError(f'joint {name} moves by {span:.3g} during the recordings, and it '
                            f'carries the arm', Hint.HELD_JOINT_MOVES)
        recorded[name] = seen[0].median
    return HeldAt(fixed, recorded)
