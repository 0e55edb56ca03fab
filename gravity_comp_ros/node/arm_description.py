"""What the node takes from a robot description: axes, joints without end, effort limits."""

from __future__ import annotations

from dataclasses import dataclass
import math
from xml.etree.ElementTree import Element

from gravity_comp_ros.description.robot_tree import parse_tree
from gravity_comp_ros.description.urdf import parse_urdf
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.kinematic.geometry import Geometry

SOURCE = 'robot_description'


@dataclass(frozen=True)
class ArmDescription:
    """
    An arm of these joints as its description has it.

    `geometry` is None where the description does not lead from joint to joint in their order;
    `problem` then says why. `max_effort` has one N·m per joint, or is empty.
    """

    geometry: Geometry | None
    continuous: tuple[str, ...]
    max_effort: tuple[float, ...]
    problem: str


def describe_arm(text: str, joints: tuple[str, ...]) -> ArmDescription:
    """Return what a URDF says of these joints; what is wrong with it is said, never raised."""
    try:
        known = parse_tree(text, SOURCE).joints
    except GravityCompError as problem:
        return ArmDescription(None, (), (), str(problem))
    continuous = tuple(name for name in joints
                       if name in known and known[name].kind == 'continuous')
    limits = [_effort(known[name].element) if name in known else math.nan for name in joints]
    max_effort = tuple(limits) if all(0.0 < limit < math.inf for limit in limits) else ()
    try:
        geometry = parse_urdf(text, joints, SOURCE)
    except GravityCompError as problem:
        return ArmDescription(None, continuous, max_effort, str(problem))
    if geometry.joints != joints:
        return ArmDescription(
            None, continuous, max_effort, f'{SOURCE} has the joints in the order '
            f'{", ".join(geometry.joints)}: give them so in the parameter joints, for their axes '
            'to be used')
    return ArmDescription(geometry, continuous, max_effort, '')


def _effort(element: Element) -> float:
    limit = next((part for part in element if part.tag.endswith('limit')), None)
    try:
        return math.nan if limit is None else float(limit.get('effort', 'nan'))
    except ValueError:
        return math.nan
