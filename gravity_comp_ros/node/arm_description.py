"""Axes, continuous joints and effort limits of an arm, from its robot description."""

from __future__ import annotations

from dataclasses import dataclass
import math
from xml.etree.ElementTree import Element

from gravity_comp_ros.description.robot_tree import parse_tree
from gravity_comp_ros.description.urdf import parse_urdf
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node.parameters import BY_NAME

SOURCE = 'robot_description'


@dataclass(frozen=True)
class ArmDescription:
    """
    The description of the joints of an arm.

    `geometry` is None where the joints do not form a serial chain in their order; `problem` then
    gives the reason. `max_effort` has one value per joint in N·m, or is empty.
    """

    geometry: Geometry | None
    continuous: tuple[str, ...]
    max_effort: tuple[float, ...]
    problem: str


def describe_arm(text: str, joints: tuple[str, ...]) -> ArmDescription:
    """Return the description of these joints in a URDF; errors go to `problem`."""
    try:
        known = parse_tree(text, SOURCE).joints
    except GravityCompError as problem:
        return ArmDescription(None, (), (), str(problem))
    continuous = tuple(name for name in joints
                       if name in known and known[name].kind == 'continuous')
    limits = [_effort(known[name].element) if name in known else math.nan for name in joints]
    # A larger number means that there is no limit.
    largest = BY_NAME['max_torque'].high or math.inf
    max_effort = tuple(limits) if all(0.0 < limit <= largest for limit in limits) else ()
    try:
        geometry = parse_urdf(text, joints, SOURCE)
    except GravityCompError as problem:
        return ArmDescription(None, continuous, max_effort, str(problem))
    if geometry.joints != joints:
        return ArmDescription(
            None, continuous, max_effort, f'the order of the joints in {SOURCE} is '
            f'{", ".join(geometry.joints)}: set the parameter joints to this order to use the '
            'axes')
    return ArmDescription(geometry, continuous, max_effort, '')


def _effort(element: Element) -> float:
    limit = next((part for part in element if part.tag.endswith('limit')), None)
    try:
        return math.nan if limit is None else float(limit.get('effort', 'nan'))
    except ValueError:
        return math.nan
