"""Options of a fit, and what is known about an arm before it: joint axes and joint order."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.api.axes import AxesOptions, known_axes, KnownAxes
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.description.joint_order import joint_order, JointOrder
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.estimate import FitOptions

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


def known_arm(recording: Recording, options: LearnOptions = LearnOptions()) -> KnownArm:
    """Return axes and joint order, from a description or the names; errors as `known_axes`."""
    axes = KnownAxes()
    if options.formulation in WITH_AXES:
        axes = known_axes(recording.reports, recording.joints, options.axes, not options.ordered)
    if axes.geometry is not None:
        return KnownArm(axes, JointOrder(axes.geometry.joints, 'description'))
    if options.ordered:
        return KnownArm(axes, JointOrder(recording.joints, ASKED))
    return KnownArm(axes, joint_order(recording.joints))
