"""Arm as known before a fit: joint order, and joint axes of a robot description."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.joint_order import AS_RECORDED, joint_order, JointOrder
from gravity_comp_ros.errors import DataError, GravityCompError, OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
import numpy as np

if TYPE_CHECKING:
    from gravity_comp_ros.api.recording import Recording
    from gravity_comp_ros.description.links import DescribedArm
    from gravity_comp_ros.description.robot_tree import RobotTree
    from gravity_comp_ros.estimation.estimate import FitOptions
    from gravity_comp_ros.recordings.bag import ReadReport

NO_DESCRIPTION = 'none'
# Formulations that use known axes.
WITH_AXES = (None, 'auto', 'chain')
ASKED = 'as asked'
# Maximum travel during the recordings of an unrecorded joint that counts as at rest, rad or m.
_AT_REST = 0.02
_SOURCES = {'option': 'as asked', 'recording': 'as recorded', 'assumption': 'assumed'}


@dataclass(frozen=True)
class ArmOptions:
    """
    Options on the arm of a fit.

    `formulation` is one of `gravity_model.CHOICES`; None is the default, which is `chain` if the
    user names a description. `urdf` is a description file, or `none`; None selects that in the
    recordings. `fixed` gives positions, in rad or m, of description joints that are not part of
    the recorded arm; the others are at their recorded position, or at 0. `ordered` is True if the
    joints are given in the order of the arm; otherwise description, names or torques give it.

    :raises OptionError: if fixed positions are given and `urdf` is `none`, or a description is
        named and the formulation does not use axes.
    """

    formulation: str | None = None
    urdf: Path | str | None = None
    fixed: Mapping[str, float] = field(default_factory=dict)
    ordered: bool = False

    def __post_init__(self) -> None:
        if self.fixed and self.urdf == NO_DESCRIPTION:
            raise OptionError('fixed joints need a robot description, and none is to be used')
        if self.file is not None and self.formulation not in WITH_AXES:
            raise OptionError(f'formulation {self.formulation} does not use a robot description; '
                              f'choose chain or auto')

    @property
    def file(self) -> Path | None:
        """Return the URDF file named by the user, if any."""
        return None if self.urdf in (None, NO_DESCRIPTION) else Path(self.urdf)

    def to_fit(self, arm: KnownArm) -> FitOptions:
        """Return the options of the estimator for an arm."""
        from gravity_comp_ros.estimation.estimate import FitOptions  # takes 0.3 s
        default = FitOptions().formulation
        if arm.geometry is not None and arm.from_user:
            # With a description from the recordings, which may be wrong, the data select it.
            default = 'chain'
        return FitOptions(formulation=self.formulation or default, geometry=arm.geometry)


@dataclass(frozen=True)
class KnownArm:
    """
    Joint order and joint axes of an arm, as known before the fit.

    `geometry` is None without a usable description. `from_user` is True if the user named its
    file. `left_out` are recorded joints outside the arm. `notes` are lines for the user. `problem`
    is the reason why the description in a recording is not used, '' for none.
    """

    order: JointOrder
    geometry: Geometry | None = None
    from_user: bool = False
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    problem: str = ''

    def of(self, recording: Recording) -> Recording:
        """Return the recording with the joints of the arm, in their order."""
        return recording.select_joints(self.order.joints)

    def to_json(self) -> dict[str, object] | None:
        """Return the description part of a result, ready for JSON."""
        if self.geometry is None:
            return None
        return {'source': self.geometry.source, 'joints': list(self.geometry.joints),
                'link': self.geometry.link, 'left_out': list(self.left_out),
                'held': {joint.name: {'value': joint.value, 'by': joint.by}
                         for joint in self.geometry.held}}


def known_arm(recording: Recording, options: ArmOptions = ArmOptions(),
              model: GravityModel | None = None) -> KnownArm:
    """
    Return joint order and axes, from the description selected by the options, or the names.

    A file named by the user must match the joints. A description in the recordings that does not
    match is not used; `problem` gives the reason. The first recording with a description provides
    it. Unless `ordered`, recorded joints outside the arm, such as those of a gripper, are left
    out.

    :param model: gives the joints, and the axes if neither the user nor a recording does.
    :raises DataError: if the file is not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    :raises OptionError: if fixed joints are given without a description.
    """
    reports, joints = recording.reports, recording.joints if model is None else model.joints
    arm = KnownArm(_order(recording, joints, options.ordered or model is not None))
    if options.urdf == NO_DESCRIPTION or options.formulation not in WITH_AXES:
        return arm
    try:
        if reports or options.file is not None:
            # Imports the XML parser.
            from gravity_comp_ros.description.robot_tree import find_description
            own = find_description(options.file, [report.path for report in reports])
            if own is not None:
                return _described(own, reports, joints, options,
                                  not options.ordered and model is None)
    except GravityCompError as problem:
        if options.file is not None or isinstance(problem, OptionError):
            raise
        return replace(arm, problem=f'robot description not used: {problem}')
    if options.fixed:
        raise OptionError('fixed joints need a robot description: no recording contains one: '
                          'name a file with --urdf')
    if model is not None and model.geometry is not None:
        return replace(arm, geometry=model.geometry, notes=('axes of the model',))
    return arm


def _order(recording: Recording, joints: tuple[str, ...], is_ordered: bool) -> JointOrder:
    """Return the order of the joints without a description; a reader orders them by the names."""
    order, reports = joint_order(joints), recording.reports
    by_name = (reports and reports[0].options.joints is None and order.joints == joints
               and order.source != AS_RECORDED)
    return JointOrder(joints, ASKED) if is_ordered and not by_name else order


def _described(tree: RobotTree, reports: Sequence[ReadReport], joints: Sequence[str],
               options: ArmOptions, choose: bool) -> KnownArm:
    chosen, left_out = tree.arm_joints(joints) if choose else (tuple(joints), {})
    geometry = described(tree, reports, chosen, left_out, options.fixed).geometry
    masses = ', its masses as a prior of the inertias' if geometry.inertials.any() else ''
    notes = [f'axes from {tree.source}{masses}']
    notes += [f'joint {name} is left out: it {reason}' for name, reason in left_out.items()]
    notes += [f'joint {joint.name} of the description is held at {joint.value:.4g} '
              f'({_SOURCES[joint.by]})' for joint in geometry.held]
    return KnownArm(JointOrder(geometry.joints, 'description'), geometry,
                    options.file is not None, tuple(left_out), tuple(notes))


def described(tree: RobotTree, reports: Sequence[ReadReport], joints: Sequence[str],
              left_out: Collection[str], fixed: Mapping[str, float]) -> DescribedArm:
    """
    Return the arm of these joints; others on the path are fixed, or held as recorded.

    :param left_out: recorded joints that are none of the arm, by `RobotTree.arm_joints`.
    :raises DataError: if a joint that carries the arm moves in a recording.
    :raises ModelMismatchError: if the description is of another arm.
    """
    # Imports the XML parser.
    from gravity_comp_ros.description.links import DescribedArm
    arm = DescribedArm(tree, joints, fixed)
    path = {joint.name for joint in tree.arm_path(joints)}
    names = [name for name in left_out if tree.joints[name].kind == 'fixed' and name in path]
    names += [name for name in arm.held_joints() if name not in fixed]
    recorded = {}
    for name, q in _positions(tree, reports, names).items():
        span, joint = np.ptp(q), tree.joints[name]
        if span > _AT_REST:
            advice = ('learn it as a joint of the arm (--joints), or give its position (--fixed '
                      'JOINT=VALUE)' if joint.revolute else
                      f'it is {joint.kind} in {tree.source}, and only revolute joints can be '
                      f'learned: correct its type, or record it at rest')
            raise DataError(f'joint {name} moves by {span:.3g} during the recordings, and it '
                            f'carries the arm: {advice}')
        recorded[name] = float(np.median(q))
    return DescribedArm(tree, joints, fixed, recorded) if recorded else arm


def carried_in_motion(arm: DescribedArm, reports: Sequence[ReadReport]) -> list[str]:
    """Return the revolute joints beyond the arm, whose links it carries, that move."""
    names = [joint.name for joint in arm.tree.joints.values() if joint.revolute
             and joint.parent in arm.places and joint.name not in arm.geometry.joints]
    return [name for name, q in _positions(arm.tree, reports, names).items()
            if np.ptp(q) > _AT_REST]


def _positions(tree: RobotTree, reports: Sequence[ReadReport],
               names: Sequence[str]) -> dict[str, FloatArray]:
    """Return the positions in rad or m of those joints that the recordings have."""
    from gravity_comp_ros.recordings.bag import joint_positions
    parts: dict[str, list[FloatArray]] = {}
    for report in reports if names else ():
        unit = report.options.position_unit
        if isinstance(unit, str):  # not that of prismatic joints
            unit = {name: unit for name in names if tree.joints[name].revolute}
        options = replace(report.options, topic=report.topic, position_unit=unit)
        for name, values in joint_positions(report.path, names, options).items():
            parts.setdefault(name, []).append(values)
    return {name: np.concatenate(values) for name, values in parts.items()}
