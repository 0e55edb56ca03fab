"""
What `fit` does from first to last: the axes and order of the arm, then its gravity.

Commands, notebooks, workbench and fleet all learn through this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.api.axes import AxesOptions, known_axes, KnownAxes
from gravity_comp_ros.api.recording import Progress, Recording
from gravity_comp_ros.api.steps import fit_model, with_enough_motion
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.description.joint_order import AS_RECORDED, joint_order, JointOrder, TORQUES
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.fit import FitOptions, FitResult
from gravity_comp_ros.estimation.joint_order_search import joint_order_from_torques
from gravity_comp_ros.estimation.refit import RefitOptions
from gravity_comp_ros.estimation.refit_result import Refit
from gravity_comp_ros.models.gravity_model import GravityModel

# Formulations that have a use for known axes.
WITH_AXES = (None, 'auto', 'chain')
ASKED = 'as asked'


@dataclass(frozen=True)
class LearnOptions:
    """
    How an arm is learned.

    `formulation` is one of `estimation.fit.CHOICES`; None is the usual one, which with a
    description that the user names is the chain on its axes. `ordered` says that the user gave
    the joints in the order of the arm; otherwise names or torques may give another.

    :raises OptionError: if a named description is of no use to the formulation.
    """

    formulation: str | None = None
    axes: AxesOptions = AxesOptions()
    ordered: bool = False

    def __post_init__(self) -> None:
        if self.axes.file is not None and self.formulation not in WITH_AXES:
            raise OptionError(f'a robot description is of no use to {self.formulation}: the axes '
                              f'are those of a chain (formulation chain or auto)')

    def to_fit(self, axes: KnownAxes) -> FitOptions:
        """Return the options of the estimator beside these axes."""
        usual = FitOptions().formulation
        if axes.geometry is not None and axes.asked:
            # A recording's own description may be wrong: there the data decide.
            usual = 'chain'
        return FitOptions(formulation=self.formulation or usual, geometry=axes.geometry)


@dataclass(frozen=True)
class KnownArm:
    """What is known of an arm before its torques are looked at: its axes, its order of joints."""

    axes: KnownAxes
    order: JointOrder

    def of(self, recording: Recording) -> Recording:
        """Return the arm's joints of a recording, in its order."""
        return recording.select_joints(self.order.joints)


@dataclass(frozen=True)
class Learned:
    """A fitted arm, with `refit` of the effects if some were fitted, and what it is based on."""

    result: FitResult
    refit: Refit | None
    arm: KnownArm
    recording: Recording

    @property
    def model(self) -> GravityModel:
        """Return the model."""
        return self.result.model


def known_arm(recording: Recording, options: LearnOptions = LearnOptions()) -> KnownArm:
    """
    Return the axes and the order of a recorded arm, as a description or the names give them.

    :raises DataError: if a named description is no URDF.
    :raises ModelMismatchError: if it is of another arm.
    :raises OptionError: if fixed joints are named and there is no description.
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
    Learn gravity, and effects beside it if some are named.

    Where nothing gives the order of the joints, the torques are asked.

    :param effects: `NAME` or `NAME:JOINT`, as `add` takes them.
    :param speeds: which samples the effects are fitted to.
    :param arm: its axes and order; found in the recording if None.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises DataError: if no sample is slow, or an effect cannot be seen.
    :raises ModelMismatchError: if the recording lacks a joint of the arm.
    """
    arm = arm or known_arm(recording, options)
    recording = arm.of(recording)
    how = options.to_fit(arm.axes)
    result, joint = fit_model(recording, how, effects, speeds, progress)
    if arm.order.source == AS_RECORDED:
        other = order_by_torques(recording, result)
        if other is not None:
            arm = replace(arm, order=other)
            recording = arm.of(recording)
            result, joint = fit_model(recording, how, effects, speeds, progress)
    told = {**result.model.provenance, 'description': arm.axes.to_json(),
            'joint_order': arm.order.source}
    return Learned(replace(result, model=replace(result.model, provenance=told)), joint, arm,
                   recording)


def model_of(recording: Recording, options: LearnOptions = LearnOptions(),
             progress: Progress | None = None, arm: KnownArm | None = None) -> GravityModel:
    """
    Return the model of gravity that `fit` makes of a recording that was read as a whole.

    :raises GravityCompError: as `learn`.
    """
    gated = replace(recording, gate=GateOptions())
    return learn(gated, options, progress=progress, arm=arm).model


def order_by_torques(recording: Recording, result: FitResult) -> JointOrder | None:
    """
    Return an order of the joints that explains their torques much better, None if there is none.

    It serves where neither a description nor the names give the order. If the residual of the
    chain is white, no other order is searched.

    :param result: of the fit in the order of the recording.
    """
    chain = result.report.chain
    if chain is not None and chain.clean:
        return None
    joints = joint_order_from_torques(with_enough_motion(recording).slow)
    return None if joints is None else JointOrder(joints, TORQUES)


def better_order(learned: Learned) -> str:
    """Return, in words, that another order of the joints explains the torques much better."""
    joints = learned.recording.joints
    if not learned.recording.reports or learned.arm.axes.geometry is not None \
            or joint_order(joints).source != AS_RECORDED:
        return ''
    other = order_by_torques(learned.recording, learned.result)
    return '' if other is None else (
        f'the order {", ".join(other.joints)} explains the torques much better: name the joints '
        f'in the order of the arm when you read')
