"""Complete fit of an arm: joint axes and joint order first, then gravity and effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.api.axes import AxesOptions, known_axes, KnownAxes
from gravity_comp_ros.api.recording import Progress, Recording
from gravity_comp_ros.api.steps import fit_model, with_enough_motion
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.description.joint_order import AS_RECORDED, joint_order, JointOrder, TORQUES
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import FitResult
from gravity_comp_ros.estimation.joint_order_search import joint_order_from_torques
from gravity_comp_ros.estimation.refit import Refit, RefitOptions
from gravity_comp_ros.models.gravity_model import GravityModel

# Formulations that use known axes.
WITH_AXES = (None, 'auto', 'chain')
ASKED = 'as asked'


@dataclass(frozen=True)
class LearnOptions:
    """
    Options of a fit.

    `formulation` is one of `estimation.estimate.CHOICES`; None is the default, which is `chain` if
    the user names a description. `ordered` is True if the joints are given in the order of the
    arm; otherwise the order is taken from names or torques.

    :raises OptionError: if a description is named and the formulation does not use axes.
    """

    formulation: str | None = None
    axes: AxesOptions = AxesOptions()
    ordered: bool = False

    def __post_init__(self) -> None:
        if self.axes.file is not None and self.formulation not in WITH_AXES:
            raise OptionError(f'formulation {self.formulation} does not use a robot description; '
                              f'choose chain or auto')

    def to_fit(self, axes: KnownAxes) -> FitOptions:
        """Return the options of the estimator for these axes."""
        default = FitOptions().formulation
        if axes.geometry is not None and axes.from_user:
            # With a description from the recordings, which may be wrong, the data select it.
            default = 'chain'
        return FitOptions(formulation=self.formulation or default, geometry=axes.geometry)


@dataclass(frozen=True)
class KnownArm:
    """Joint axes and joint order of an arm, as known before the fit."""

    axes: KnownAxes
    order: JointOrder

    def of(self, recording: Recording) -> Recording:
        """Return the recording with the joints of the arm, in their order."""
        return recording.select_joints(self.order.joints)


@dataclass(frozen=True)
class Learned:
    """A fit, with the `refit` of its effects (None without effects), and its arm and samples."""

    result: FitResult
    refit: Refit | None
    arm: KnownArm
    recording: Recording

    @property
    def model(self) -> GravityModel:
        """Return the fitted model."""
        return self.result.model


def known_arm(recording: Recording, options: LearnOptions = LearnOptions()) -> KnownArm:
    """
    Return the axes and the joint order of a recorded arm, from a description or the names.

    :raises DataError: if a named description is not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    :raises OptionError: if fixed joints are given without a description.
    """
    axes = KnownAxes()
    if options.formulation in WITH_AXES:
        axes = known_axes(recording.reports, recording.joints, options.axes, not options.ordered)
    if axes.geometry is not None:
        return KnownArm(axes, JointOrder(axes.geometry.joints, 'description'))
    if options.ordered:
        return KnownArm(axes, JointOrder(recording.joints, ASKED))
    return KnownArm(axes, joint_order(recording.joints))


def learn(recording: Recording, options: LearnOptions = LearnOptions(),
          effects: Sequence[str] = (), speeds: RefitOptions = RefitOptions(),
          progress: Progress | None = None, arm: KnownArm | None = None) -> Learned:
    """
    Fit gravity, jointly with the named effects.

    If neither description nor names give the joint order, it is identified from the torques.

    :param effects: effects as in `gravity_comp_ros.fit`.
    :param speeds: selection of the samples that the effects are fitted to.
    :param arm: axes and joint order; None takes them from the recording.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises DataError: if no sample is slow, or an effect is not identifiable.
    :raises ModelMismatchError: if a joint of the arm is missing in the recording.
    """
    arm = arm or known_arm(recording, options)
    recording = arm.of(recording)
    fit_options = options.to_fit(arm.axes)
    result, refit = fit_model(recording, fit_options, effects, speeds, progress)
    if arm.order.source == AS_RECORDED:
        order = order_by_torques(recording, result)
        if order is not None:
            arm = replace(arm, order=order)
            recording = arm.of(recording)
            result, refit = fit_model(recording, fit_options, effects, speeds, progress)
    provenance = {**result.model.provenance, 'description': arm.axes.to_json(),
                  'joint_order': arm.order.source}
    return Learned(replace(result, model=replace(result.model, provenance=provenance)), refit,
                   arm, recording)


def learn_gravity(recording: Recording, options: LearnOptions = LearnOptions(),
                  progress: Progress | None = None, arm: KnownArm | None = None) -> GravityModel:
    """
    Return the gravity model that `fit` yields for a recording read without a gate.

    :raises GravityCompError: as `learn`.
    """
    gated = replace(recording, gate=GateOptions())
    return learn(gated, options, progress=progress, arm=arm).model


def order_by_torques(recording: Recording, result: FitResult) -> JointOrder | None:
    """
    Return a joint order with a much smaller residual torque, None if there is none.

    If the residual of the fit is white, no other order is searched.

    :param result: fit in the order of the recording.
    """
    if result.report.white:
        return None
    joints = joint_order_from_torques(with_enough_motion(recording).slow)
    return None if joints is None else JointOrder(joints, TORQUES)


def joint_order_warning(learned: Learned) -> str:
    """Return a warning if another joint order explains the torques much better, else ''."""
    if not learned.recording.reports or learned.arm.axes.geometry is not None \
            or joint_order(learned.recording.joints).source != AS_RECORDED:
        return ''
    order = order_by_torques(learned.recording, learned.result)
    return '' if order is None else (
        f'the joint order {", ".join(order.joints)} explains the torques much better: read the '
        f'recording with `joints` in the order of the arm')
