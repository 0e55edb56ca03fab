"""Arguments of `gravity_comp replay`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
topics of the output, all sensor_msgs/JointState:
  /joint_states              effort = measured torque, N·m
  /gravity_comp/prediction   effort = torque of the model, gravity and effects, N·m
  /gravity_comp/residual     effort = measured minus predicted torque, N·m

examples:
  gravity_comp replay run2.mcap --model arm.json -o out.mcap
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `replay`."""
    arguments.add_bags(parser, nargs=None)
    parser.add_argument('--model', metavar='M.json', type=Path, required=True,
                        help='model file')
    parser.add_argument('-o', '--output', metavar='OUT.mcap', type=arguments.mcap_file,
                        required=True, help='file to write; an existing file is replaced')
    arguments.add_reading(parser)
    arguments.add_json(parser)
