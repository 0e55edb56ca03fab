"""
An estimated payload in the frame of a flange, and as lines for the settings of drives.

Each line follows the source named with it. None was tested on its robot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.links import DescribedArm
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.applied_effects import Quantity
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

_AXES = 'xyz'


@dataclass(frozen=True)
class Payload:
    """A payload: mass in kg and centre of mass in m by axis, in the coordinates of `frame`."""

    frame: str
    mass: Quantity
    centre: Mapping[str, Quantity]

    def sentence(self) -> str:
        """Return mass and centre with their 95 % intervals."""
        low, high = self.mass.ci95
        return (f'{self.mass.value:.3f} kg (95 %: {low:.3f} to {high:.3f}), centre of mass in '
                f'the frame of {self.frame}: {millimetres(self.centre)}')


@dataclass(frozen=True)
class DriveLine:
    """A line for the program of one maker's robot, and the source of its form."""

    maker: str
    line: str
    source: str


def millimetres(centre: Mapping[str, Quantity]) -> str:
    """Return a centre of mass in m as text in mm with its 95 % intervals."""
    return ', '.join(f'{axis} {1e3 * x.value:.1f} mm ({1e3 * x.ci95[0]:.1f} to '
                     f'{1e3 * x.ci95[1]:.1f})' for axis, x in centre.items())


def payload_of(model: GravityModel) -> Payload:
    """
    Return the payload of the last update of a model, in the frame of the last joint's link.

    A removed payload has a negative mass.

    :raises DataError: if the model has none, or its mass does not differ from 0.
    """
    return _payload((model.provenance.get('updates') or [{}])[-1])


def load_of(model: GravityModel) -> Payload:
    """
    Return the payloads of all updates of a model as one, in the frame of the last joint's link.

    It is relative to the arm of the fit. The errors of the updates count as independent: that of
    an earlier one is part of the next one with the opposite sign, so that the intervals of the sum
    are not too narrow.

    :raises DataError: if the model has none, or the mass of one of them does not differ from 0.
    """
    updates = model.provenance.get('updates') or [{}]
    parts = [_payload(update) for update in updates]
    if len(parts) == 1:
        return parts[0]
    masses, widths = np.array([(part.mass.value, part.mass.half) for part in parts]).T
    centres, errors = (np.array(values) for values in zip(*map(_centre, parts)))
    total, width = float(masses.sum()), float(np.sqrt((widths ** 2).sum()))
    if len({part.frame for part in parts}) > 1 or abs(total) <= width:
        raise DataError(f'the payloads of the {len(parts)} updates have no known sum: update a '
                        'model of the arm without tool to the present state')
    centre = masses @ centres / total
    # Errors of the moments of all parts, each by its mass and its centre about that of the sum.
    spread = np.sqrt((masses ** 2) @ errors ** 2 + widths ** 2 @ (centres - centre) ** 2) / abs(
        total)
    return Payload(parts[-1].frame, Quantity.around(total, 'kg', width), {
        axis: Quantity.around(x, 'm', w) for axis, x, w in zip(_AXES, centre, spread)})


def _payload(update: Mapping[str, Any]) -> Payload:
    estimate = update.get('payload')
    if estimate is None:
        raise DataError('the model has no estimate of a payload: `gravity_comp update BAG --model '
                        'MODEL --urdf FILE` makes one')
    mass = _quantity(estimate['mass'])
    if estimate['centre'] is None:
        low, high = mass.ci95
        raise DataError(f'the mass of the payload does not differ from 0 (95 %: {low:.3f} to '
                        f'{high:.3f} kg), so it has no centre of mass')
    return Payload(str(estimate['link']), mass,
                   {axis: _quantity(x) for axis, x in estimate['centre'].items()})


def _centre(payload: Payload) -> tuple[FloatArray, FloatArray]:
    """Return a centre of mass and the half widths of its intervals, (3,) in m."""
    values, halves = np.array([(x.value, x.half) for x in (
        payload.centre[axis] for axis in _AXES)]).T
    return values, halves


def in_frame(payload: Payload, arm: DescribedArm, frame: str) -> Payload:
    """
    Return a payload in the coordinates of another link that the last joint carries.

    The errors of the three coordinates count as independent.

    :raises ModelMismatchError: if the arm carries no such link, or not that of the payload.
    :raises DataError: if joints move between both links.
    """
    old, new = arm.place(payload.frame), arm.place(frame)
    if old.joint != new.joint:
        raise DataError(f'link {frame} turns against {payload.frame}, to which the payload is '
                        f'fixed: name a flange beyond joint {arm.geometry.joints[old.joint]}')
    rotation = new.rotation.T @ old.rotation
    centre, half = _centre(payload)
    moved = rotation @ centre + new.rotation.T @ (old.origin - new.origin)
    width = np.sqrt(rotation ** 2 @ half ** 2)
    return Payload(frame, payload.mass, {
        axis: Quantity.around(x, 'm', w) for axis, x, w in zip(_AXES, moved, width)})


def drive_lines(payload: Payload) -> tuple[DriveLine, ...]:
    """
    Return the lines of all makers; inertias are 0, since slow motion does not excite them.

    :raises DataError: if the payload was removed: its mass is negative.
    """
    if payload.mass.value <= 0.0:
        raise DataError(f'the updates removed {-payload.mass.value:.3f} kg, and a drive takes '
                        f'no negative mass: update a model of the arm without tool to the '
                        f'present state')
    mass = f'{payload.mass.value:.3f}'
    x, y, z = (f'{payload.centre[axis].value:.4f}' for axis in _AXES)
    mx, my, mz = (f'{1e3 * payload.centre[axis].value:.1f}' for axis in _AXES)
    zeros = ', '.join(9 * ['0.0'])
    return (
        DriveLine('UR, URScript', f'set_target_payload({mass}, [{x}, {y}, {z}])',
                  'URScript manual, set_target_payload(m, cog, inertia): kg, m from the flange'),
        DriveLine('UR, ROS 2 driver of Jazzy',
                  f'ros2 service call /io_and_status_controller/set_payload '
                  f'ur_msgs/srv/SetPayload "{{mass: {mass}, center_of_gravity: '
                  f'{{x: {x}, y: {y}, z: {z}}}}}"',
                  'docs.ros.org/en/jazzy/p/ur_msgs/srv/SetPayload.html'),
        DriveLine('UR, ROS 2 driver of its main branch',
                  f'ros2 service call /io_and_status_controller/set_payload '
                  f'ur_msgs/srv/SetPayload "{{payload: {{m: {mass}, '
                  f'com: {{x: {x}, y: {y}, z: {z}}}}}}}"',
                  'Universal_Robots_ROS2_Driver, ur_robot_driver/doc/migration/makoa.rst'),
        DriveLine('Franka, libfranka',
                  f'robot.setLoad({mass}, {{{{{x}, {y}, {z}}}}}, {{{{{zeros}}}}});',
                  'libfranka, include/franka/robot.h, Robot::setLoad: kg, m from the flange'),
        DriveLine('Franka, franka_ros2',
                  f'ros2 service call /service_server/set_load franka_msgs/srv/SetLoad '
                  f'"{{mass: {mass}, center_of_mass: [{x}, {y}, {z}], load_inertia: [{zeros}]}}"',
                  'docs.ros.org/en/humble/p/franka_msgs/srv/SetLoad.html; franka_ros2, '
                  'franka_hardware, services'),
        DriveLine('KUKA, KRL',
                  f'LOAD_DATA[1]={{M {mass},CM {{X {mx},Y {my},Z {mz},A 0.0,B 0.0,C 0.0}},'
                  f'J {{X 0.0,Y 0.0,Z 0.0}}}}',
                  'KUKA $config.dat, LOAD_DATA: kg, mm and degrees from the flange, kg m^2'),
        DriveLine('xArm, Python SDK', f'arm.set_tcp_load({mass}, [{mx}, {my}, {mz}])',
                  'xArm-Python-SDK, doc/api/xarm_api.md, set_tcp_load: kg, mm'),
        DriveLine('Kinova, Kortex API',
                  f'tool = config.GetToolConfiguration(); tool.tool_mass = {mass}; '
                  f'tool.tool_mass_center.x, tool.tool_mass_center.y, tool.tool_mass_center.z = '
                  f'{x}, {y}, {z}; config.SetToolConfiguration(tool)',
                  'Kinova-kortex2_Gen3_G3L, api_python/doc, ControlConfig/ToolConfiguration.md: '
                  'kg, m from the interface module'))


def _quantity(parts: Mapping[str, Any]) -> Quantity:
    return Quantity(float(parts['value']), str(parts['unit']),
                    (float(parts['ci95'][0]), float(parts['ci95'][1])))
