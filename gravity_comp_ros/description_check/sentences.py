"""Faults of a description as sentences, with the changed line or option that corrects them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.links import DescribedArm
from gravity_comp_ros.description.robot_tree import TreeJoint
from gravity_comp_ros.description_check.check import DescriptionCheck
from gravity_comp_ros.description_check.faults import (
    AXIS_REVERSED, AXIS_TURNED, BODY, GAIN, MASS, MOUNT, ORDER, UNIT, ZERO)
from gravity_comp_ros.description_check.search import FaultFit
from gravity_comp_ros.models.kinematic.chain import about, aligned, tilt
import numpy as np

_WORDS = {ZERO: 'the zero angle', AXIS_TURNED: 'the direction of the axis',
          AXIS_REVERSED: 'the sign of the axis', MOUNT: 'the mount'}


@dataclass(frozen=True)
class Finding:
    """
    A fault as text: `sentence`, and `correction`, the changed line or option.

    `value` with its unit and 95 % interval is its size, None for a fault without a size.
    `alternatives` are other faults that explain the recording as well.
    """

    kind: str
    subjects: tuple[str, ...]
    sentence: str
    correction: str
    value: float | None
    unit: str
    ci95: tuple[float, float] | None
    evidence: float
    alternatives: tuple[str, ...] = ()


def findings(check: DescriptionCheck, arm: DescribedArm,
             scales: Mapping[str, float] = MappingProxyType({})) -> list[Finding]:
    """
    Return the faults of a check as sentences, the worst first.

    :param scales: `--effort-scale` by joint with which the recording was read.
    """
    writer = _Writer(arm, scales)
    return [writer.finding(fit) for fit in check.faults]


def error_rows(check: DescriptionCheck) -> list[tuple[str, str, str, str]]:
    """Return for each joint its name, torque (RMS), and errors as described and corrected."""
    return [(joint, f'{torque:.3f}', f'{before:.4f}', f'{after:.4f}') for joint, torque, before,
            after in zip(check.joints, check.torque, check.before, check.after)]


def unchecked_sentences(check: DescriptionCheck) -> list[str]:
    """Return a sentence for each kind of fault that the recording does not show on some joints."""
    return [f'not checked: {_WORDS[kind]} of {", ".join(subjects)} (this motion does not show it)'
            for kind, subjects in check.unchecked.items()]


class _Writer:
    """Sentences about an arm of a description."""

    def __init__(self, arm: DescribedArm, scales: Mapping[str, float]) -> None:
        self.arm, self.scales = arm, scales
        self._texts: Mapping[str, Callable[[FaultFit, str], tuple]] = {
            AXIS_REVERSED: self._reversed, AXIS_TURNED: self._turned, ZERO: self._zero,
            ORDER: self._order, MOUNT: self._mount, GAIN: self._gain, UNIT: self._unit,
            MASS: self._mass, BODY: self._body}

    def finding(self, fit: FaultFit) -> Finding:
        subject = fit.fault.subjects[0]
        sentence, correction, value, std, unit = self._texts[fit.fault.kind](fit, subject)
        ci95 = None if value is None else (value - HALF_95 * std, value + HALF_95 * std)
        others = tuple(self._texts[other.fault.kind](other, other.fault.subjects[0])[0]
                       for other in fit.alternatives)
        return Finding(fit.fault.kind, fit.fault.subjects, sentence, correction, value, unit,
                       ci95, fit.evidence, others)

    def _joint(self, name: str) -> TreeJoint:
        return self.arm.tree.joints[name]

    def _reversed(self, fit: FaultFit, joint: str) -> tuple:
        return (f'the axis of {joint} is reversed: angle and torque have the other sign',
                f'<joint name="{joint}">: {_axis(-self._joint(joint).axis())}', None, 0.0, '')

    def _turned(self, fit: FaultFit, joint: str) -> tuple:
        angle, std = _angle(fit)
        axis = aligned(self._joint(joint).axis()) @ tilt(fit.parameters[None])[0][:, 2]
        return (f'the axis of {joint} is turned by {angle:.1f} ± {HALF_95 * std:.1f} deg',
                f'<joint name="{joint}">: {_axis(axis)}', angle, std, 'deg')

    def _zero(self, fit: FaultFit, joint: str) -> tuple:
        value, std = np.rad2deg(fit.parameters[0]), np.rad2deg(np.sqrt(fit.covariance[0, 0]))
        origin = self._joint(joint)
        turned = origin.rotation() @ about(origin.axis(), float(fit.parameters[0]))
        return (f'the zero angle of {joint} is off by {value:+.1f} ± {HALF_95 * std:.1f} deg: the '
                f'true angle is the recorded one {value:+.1f} deg',
                f'<joint name="{joint}">: <origin rpy="{_rpy(turned)}"/>',
                float(value), float(std), 'deg')

    def _order(self, fit: FaultFit, _: str) -> tuple:
        first, second = fit.fault.subjects
        return (f'the joints {first} and {second} are exchanged in the recording or the '
                f'description', f'--rename {first}={second},{second}={first}', None, 0.0, '')

    def _mount(self, fit: FaultFit, _: str) -> tuple:
        angle, std = _angle(fit)
        axis = fit.parameters / max(float(np.hypot(*fit.parameters)), 1e-12)
        first = self.arm.tree.path(self.arm.geometry.joints[0])[0]
        turned = tilt(fit.parameters[None])[0] @ first.rotation()
        return (f'the base is mounted turned by {angle:.1f} ± {HALF_95 * std:.1f} deg about the '
                f'axis ({axis[0]:.2f}, {axis[1]:.2f}, 0) of {first.parent}',
                f'<joint name="{first.name}">: <origin rpy="{_rpy(turned)}"/>, its xyz turned '
                f'likewise', angle, std, 'deg')

    def _gain(self, fit: FaultFit, joint: str) -> tuple:
        gain, std = fit.parameters[0], float(np.sqrt(fit.covariance[0, 0]))
        return (f'the effort of {joint} is {gain:.3f} ± {HALF_95 * std:.3f} times the torque',
                self._effort_scale((joint,), gain), float(gain), std, '')

    def _unit(self, fit: FaultFit, _: str) -> tuple:
        gain, std = fit.parameters[0], float(np.sqrt(fit.covariance[0, 0]))
        return (f'the efforts of all joints are {gain:.3f} ± {HALF_95 * std:.3f} times the torque '
                f'(or all masses are)', self._effort_scale(self.arm.geometry.joints, gain),
                float(gain), std, '')

    def _effort_scale(self, joints: tuple[str, ...], gain: float) -> str:
        """Return the option as given, with the scales of some joints divided by a gain."""
        scales = {**self.scales, **{joint: self.scales.get(joint, 1.0) / gain for joint in joints}}
        return '--effort-scale ' + ','.join(f'{joint}={x:.4g}' for joint, x in scales.items())

    def _mass(self, fit: FaultFit, link: str) -> tuple:
        described = self.arm.inertials()[link].mass
        mass = described * (1.0 + fit.parameters[0])
        std = described * float(np.sqrt(fit.covariance[0, 0]))
        return (f'the mass of {link} is {mass:.3f} ± {HALF_95 * std:.3f} kg, not '
                f'{described:.3f} kg',
                f'<link name="{link}">: <mass value="{mass:.4g}"/>', float(mass), std, 'kg')

    def _body(self, fit: FaultFit, joint: str) -> tuple:
        mass, std = float(fit.parameters[0]), float(np.sqrt(fit.covariance[0, 0]))
        child = self._joint(joint).child
        rotation = self.arm.places[child].rotation
        moment = rotation.T @ fit.parameters[1:]
        if mass > HALF_95 * std:
            at = ' '.join(f'{x:.3f}' for x in np.round(moment / mass, 3) + 0.0)
            return (f'{child} carries {mass:.2f} ± {HALF_95 * std:.2f} kg that the description '
                    f'has not, at ({at}) m in its frame',
                    f'<link> with <mass value="{mass:.3g}"/> and <origin xyz="{at}"/>, fixed to '
                    f'{child}', mass, std, 'kg')
        text = ', '.join(f'{x:+.3f}' for x in moment)
        return (f'the masses or centres of {child} and the links beyond differ from the '
                f'description: the first moment by ({text}) kg m in the frame of {child}',
                '`gravity_comp fit` and `gravity_comp export --to urdf` write those identified',
                mass, std, 'kg')


def _angle(fit: FaultFit) -> tuple[float, float]:
    """Return the angle of a rotation by two parameters and its standard deviation, deg."""
    angle = float(np.hypot(*fit.parameters))
    along = fit.parameters / max(angle, 1e-12)
    return float(np.rad2deg(angle)), float(np.rad2deg(np.sqrt(along @ fit.covariance @ along)))


def _axis(axis: FloatArray) -> str:
    return f'<axis xyz="{" ".join(f"{x + 0.0:.5g}" for x in np.round(axis, 6))}"/>'


def _rpy(rotation: FloatArray) -> str:
    """Return roll, pitch and yaw of a rotation (3, 3), rad."""
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    # At a pitch of a right angle, roll is all that any yaw leaves.
    rest = about(np.array([0.0, 0.0, 1.0]), -float(yaw)) @ rotation
    roll = np.arctan2(-rest[1, 2], rest[1, 1])
    return ' '.join(f'{float(x) + 0.0:.6g}' for x in (roll, pitch, yaw))
