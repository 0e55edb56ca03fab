"""Arguments of `gravity_comp check`."""

from __future__ import annotations

import argparse

from gravity_comp_ros.commands import arguments

EPILOG = """\
Is this description that of the recorded arm? Compared are: axes reversed or turned, zero angles,
joints exchanged, the mount of the base, factors and signs of efforts, masses, and bodies that the
description has not. Every fault is one sentence, the worst first, with the line of the
description or the option that corrects it. What the motion does not show is listed too.

which recordings: slow motion of all joints over tens of degrees, without contact.

examples:
  gravity_comp check run1.mcap run2.mcap --urdf robot.urdf
  gravity_comp check run1.mcap --urdf robot.urdf --json check.json

exit status: 0 no fault, 3 faults (for tests of a robot's software), 1 failed, 2 wrong usage.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `check`."""
    arguments.add_bags(parser)
    arguments.add_description(parser, 'description to check (default: /robot_description in the '
                              'recording)')
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)
