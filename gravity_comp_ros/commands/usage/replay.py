"""What `gravity_comp replay` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
topics of the output, all sensor_msgs/JointState:
  /joint_states              as measured, in N·m
  /gravity_comp/prediction   effort = what the model says: gravity, and the effects it has
  /gravity_comp/residual     effort = measured minus predicted

examples:
  gravity_comp replay run2.mcap --model arm.json -o out.mcap
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `replay`."""
    arguments.add_bags(parser, nargs=None)
    parser.add_argument('--model', metavar='M.json', type=Path, required=True,
                        help='model to predict with')
    parser.add_argument('-o', '--output', metavar='OUT.mcap', type=arguments.mcap_file,
                        required=True, help='file to write; an older one is replaced')
    arguments.add_reading(parser)
    arguments.add_json(parser)
