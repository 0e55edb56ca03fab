"""What `gravity_comp info` takes."""

from __future__ import annotations

import argparse

from gravity_comp_ros.commands import arguments

EPILOG = """\
columns of the table:
  range      least and greatest angle, in degrees
  speed      rms and greatest, in rad/s; the gate wants every joint slow at once
  reversals  changes of direction; they excite friction
  effort     least and greatest, in N·m (or in the unit of the driver)

examples:
  gravity_comp info run1.mcap
  gravity_comp info rosbag2_folder/ old.db3 --max-speed 0.2
  gravity_comp info run1.mcap --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `info`."""
    arguments.add_bags(parser)
    arguments.add_reading(parser)
    arguments.add_gate(parser)
    arguments.add_json(parser)
