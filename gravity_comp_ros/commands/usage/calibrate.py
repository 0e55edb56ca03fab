"""Arguments of `gravity_comp calibrate`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
A known weight gives the torque in N·m per unit of effort of every joint that it loads, for a
driver that publishes currents or uncalibrated torques. No mass of the arm is needed; the link
lengths come from the URDF.

which recordings: two of slow motion, without and with the weight, over most of the range of each
joint. The heavier the weight and the wider the motion, the smaller the intervals.

examples:
  gravity_comp calibrate empty.mcap loaded.mcap --mass 2.0 --urdf robot.urdf
  gravity_comp calibrate empty.mcap loaded.mcap --mass 2.0 --com 0 0 0.08 --link tool0
                                                    weight with a known centre, on tool0
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `calibrate`."""
    parser.add_argument('empty', metavar='EMPTY', type=Path, help='recording without the weight')
    parser.add_argument('loaded', metavar='LOADED', type=Path, help='recording with the weight')
    parser.add_argument('--mass', metavar='KG', type=arguments.positive, required=True,
                        help='mass of the weight')
    parser.add_argument('--com', metavar=('X', 'Y', 'Z'), type=arguments.finite, nargs=3,
                        default=None, help='centre of mass of the weight in the frame of --link, '
                        'm (default: estimated)')
    parser.add_argument('--link', metavar='LINK', default=None,
                        help='link that carries the weight (default: that of the last joint)')
    parser.add_argument('--same-zero', action='store_true',
                        help='the torque sensors kept their zero between the recordings, without '
                        'a restart: one offset for both, and smaller intervals')
    arguments.add_description(parser, 'axes and link lengths (default: /robot_description in a '
                              'recording)')
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)
