"""What `gravity_comp fleet` takes."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp fleet fit recordings/ -o models/          recordings/ROBOT/*.mcap
  gravity_comp fleet diagnose recordings/ --models models/ -o findings/
  gravity_comp fleet fit recordings/ -o models/ --workers 8
  gravity_comp fleet fit /nfs/recordings -o models/ --scheduler tcp://10.0.0.5:8786

Each subfolder is a robot and has its bags. A bag or robot that fails is reported and left out.
Interrupted, the same command goes on where it stopped; with more bags, only what is new is done.
A Dask cluster must see the bags under the same path, and have this package installed.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fleet`."""
    parser.add_argument('what', choices=('fit', 'diagnose'), help='what to do with each robot')
    parser.add_argument('folder', metavar='FOLDER', type=Path,
                        help='a folder for each robot, the bags of that robot in it')
    parser.add_argument('-o', '--output', metavar='FOLDER', type=Path, required=True,
                        help='where results go: ROBOT.json, ROBOT.diagnosis.json')
    where = parser.add_mutually_exclusive_group()
    where.add_argument('--workers', metavar='N', type=arguments.count, default=os.cpu_count() or 1,
                       help='processes on this machine (default: one a core)')
    where.add_argument('--scheduler', metavar='ADDRESS', default=None,
                       help='a Dask scheduler, e.g. tcp://10.0.0.5:8786')
    parser.add_argument('--formulation', choices=arguments.FORMULATIONS,
                        default=arguments.FORMULATIONS[0],
                        help='what `fit` fits (default: %(default)s)')
    parser.add_argument('--models', metavar='FOLDER', type=Path, default=None,
                        help='`diagnose` judges FOLDER/ROBOT.json (default: models are fitted)')
    parser.add_argument('--effects', metavar='A,B,...', type=arguments.joint_list, default=None,
                        help='`diagnose` looks for these effects only (default: all)')
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)
    parser.set_defaults(output_is_folder=True)
