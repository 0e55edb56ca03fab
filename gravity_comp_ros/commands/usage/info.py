"""Arguments of `gravity_comp info`."""

from __future__ import annotations

import argparse

from gravity_comp_ros.commands import arguments

EPILOG = """\
columns of the table:
  range      minimum and maximum angle, in rad
  travel     distance from minimum to maximum angle, in rad
  rms, max   speed in rad/s; the slow-motion gate requires all joints slow at the same time
  reversals  changes of direction; they excite friction
  effort     minimum and maximum, in N·m (or in the unit of the driver)

examples:
  gravity_comp info run1.mcap
  gravity_comp info rosbag2_folder/ old.db3 --max-speed 0.2
  gravity_comp info run1.mcap --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `info`."""
    arguments.add_bags(parser)
    arguments.add_urdf(parser, 'axes to compare the directions and zeros of the joints with')
    arguments.add_reading(parser)
    arguments.add_gate(parser)
    arguments.add_json(parser)
