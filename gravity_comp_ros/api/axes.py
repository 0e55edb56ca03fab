"""Joint axes from a robot description: from a file, from the recordings, or none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from gravity_comp_ros.errors import DataError, GravityCompError, Hint, OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
import numpy as np

if TYPE_CHECKING:
    from gravity_comp_ros.description.urdf import HeldPositions
    from gravity_comp_ros.recordings.bag import ReadReport

NO_DESCRIPTION = 'none'
# Maximum travel during the recordings of an unrecorded joint that counts as at rest, rad or m.
_AT_REST = 0.02
_SOURCES = {'option': 'as asked', 'recording': 'as recorded', 'assumption': 'assumed'}


@dataclass(frozen=True)
class AxesOptions:
    """
    Source of the joint axes of an arm.

    `urdf` is a file, or `none`; None selects the description in the recordings. `fixed` gives
    positions, in rad or m, of description joints that are not part of the recorded arm; the
    others are at their recorded position, or at 0.

    :raises OptionError: if fixed positions are given and `urdf` is `none`.
    """

    urdf: Path | str | None = None
    fixed: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.fixed and self.urdf == NO_DESCRIPTION:
            raise OptionError('fixed joints need a robot description, and none is to be used')

    @property
    def file(self) -> Path | None:
        """Return the URDF file named by the user, if any."""
        return None if self.urdf in (None, NO_DESCRIPTION) else Path(self.urdf)


@dataclass(frozen=True)
class KnownAxes:
    """
    Joint axes from a robot description; `geometry` is None without a usable one.

    `from_user` is True if the user named the file. `left_out` are recorded joints outside the
    arm. `notes` are lines for the user. `problem` is the reason why the description in a
    recording is not used, '' for none.
    """

    geometry: Geometry | None = None
    from_user: bool = False
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    problem: str = ''

    def to_json(self) -> dict[str, object] | None:
        """Return the description part of a result, ready for JSON."""
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
    Return the axes of these joints from the description selected by the options.

    A file named by the user must match the joints. A description in the recordings that does not
    match is not used; `problem` gives the reason.

    :param reports: of the recordings; the first recording with a description provides it.
    :param choose: leave out recorded joints outside the arm, such as those of a gripper.
    :param model: source of the axes if neither the user nor a recording gives a description.
    :raises DataError: if the file is not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    :raises OptionError: if fixed joints are given without a description.
    """
    if options.urdf == NO_DESCRIPTION:
        return KnownAxes()
    try:
        if reports or options.file is not None:
            # Imports the XML parser.
            from gravity_comp_ros.description.urdf import find_description
            own = find_description(options.file, [report.path for report in reports])
            if own is not None:
                return _axes(reports, joints, options, choose, own.text, own.source)
    except GravityCompError as problem:
        if options.file is not None or isinstance(problem, OptionError):
            raise
        return KnownAxes(problem=f'robot description not used: {problem}')
    if options.fixed:
        raise OptionError('fixed joints need a robot description: no recording contains one',
                          Hint.NAME_DESCRIPTION)
    if model is not None and model.geometry is not None:
        return KnownAxes(model.geometry, notes=('axes of the model',))
    return KnownAxes()


def _axes(reports: Sequence[ReadReport], joints: Sequence[str], options: AxesOptions,
          choose: bool, text: str | bytes, source: str) -> KnownAxes:
    # Imports the XML parser.
    from gravity_comp_ros.description.links import described_arm
    from gravity_comp_ros.description.robot_tree import arm_joints
    chosen, left_out = arm_joints(text, joints, source) if choose else (tuple(joints), {})
    held = _held_positions(reports, options.fixed, text, chosen, source)
    geometry = described_arm(text, chosen, source, held).geometry
    masses = ', its masses as a prior of the inertias' if geometry.inertials.any() else ''
    notes = [f'axes from {source}{masses}']
    notes += [f'joint {name} is left out: it {reason}' for name, reason in left_out.items()]
    notes += [f'joint {joint.name} of the description is held at {joint.value:.4g} '
              f'({_SOURCES[joint.by]})' for joint in geometry.held]
    return KnownAxes(geometry, options.file is not None, tuple(left_out), tuple(notes))


def _held_positions(reports: Sequence[ReadReport], fixed: Mapping[str, float],
                    text: str | bytes, joints: Sequence[str], source: str) -> HeldPositions:
    """Return the positions of the other joints on the path, from the options or recordings."""
    from gravity_comp_ros.description.urdf import held_joints, HeldPositions
    names = [name for name in held_joints(text, joints, source) if name not in fixed]
    if not names:
        return HeldPositions(fixed)
    from gravity_comp_ros.recordings.bag import joint_positions
    recordings = [joint_positions(report.path, names, report.topic) for report in reports]
    recorded = {}
    for name in names:
        own = [positions[name] for positions in recordings if name in positions]
        if not own:
            continue
        span = np.ptp(np.concatenate(own))
        if span > _AT_REST:
            raise DataError(f'joint {name} moves by {span:.3g} during the recordings, and it '
                            f'carries the arm', Hint.HELD_JOINT_MOVES)
        recorded[name] = float(np.median(own[0]))
    return HeldPositions(fixed, recorded)
