"""Robot description of a verb: from --urdf, or from the recordings."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from gravity_comp_ros.description.link_places import described_arm, DescribedArm
from gravity_comp_ros.description.serial_arm import arm_joints
from gravity_comp_ros.description.urdf import HeldPositions, read_text
from gravity_comp_ros.errors import DataError, Hint
from gravity_comp_ros.recordings.bag import ReadReport


def text_of(args: argparse.Namespace, reports: Sequence[ReadReport]) -> tuple[bytes | str, str]:
    """
    Return the text of the description and its source for messages.

    :raises DataError: if there is none.
    """
    if args.urdf is not None:
        return read_text(args.urdf), str(args.urdf)
    from gravity_comp_ros.recordings.robot_description import first_description
    recorded = first_description(report.path for report in reports)
    if recorded is None:
        raise DataError('no recording contains a robot description', Hint.NAME_DESCRIPTION)
    return recorded.text, recorded.source


def arm_of(args: argparse.Namespace, text: bytes | str, source: str,
           recorded: Sequence[str]) -> DescribedArm:
    """Return the described arm among the recorded joints, with the joints of --fixed held."""
    return described_arm(text, arm_joints(text, recorded, source).joints, source, held(args))


def held(args: argparse.Namespace) -> HeldPositions:
    """Return the positions of --fixed."""
    return HeldPositions({name: value for part in args.fixed for name, value in part.items()})
