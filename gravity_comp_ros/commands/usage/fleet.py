"""Arguments of `gravity_comp fleet`."""

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

Each subfolder contains the bags of one robot. A bag or robot that fails is reported and omitted.
After an interruption the same command resumes; after new bags it processes only what changed.
A Dask cluster requires the bags under the same path and this package installed.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fleet`."""
    parser.add_argument('what', choices=('fit', 'diagnose'), help='operation for each robot')
    parser.add_argument('folder', metavar='FOLDER', type=Path,
                        help='folder with one subfolder of bags for each robot')
    parser.add_argument('-o', '--output', metavar='FOLDER', type=Path, required=True,
                        help='output folder: ROBOT.json, ROBOT.diagnosis.json')
    where = parser.add_mutually_exclusive_group()
    where.add_argument('--workers', metavar='N', type=arguments.count, default=os.cpu_count() or 1,
                       help='processes on this machine (default: one per core)')
    where.add_argument('--scheduler', metavar='ADDRESS', default=None,
                       help='Dask scheduler, e.g. tcp://10.0.0.5:8786')
    parser.add_argument('--formulation', choices=arguments.FORMULATIONS,
                        default=arguments.FORMULATIONS[0],
                        help='formulation of `fit` (default: %(default)s)')
    parser.add_argument('--models', metavar='FOLDER', type=Path, default=None,
                        help='`diagnose` uses FOLDER/ROBOT.json (default: models are fitted)')
    parser.add_argument('--effects', metavar='A,B,...', type=arguments.joint_list, default=None,
                        help='`diagnose` tests these effects only (default: all)')
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)
    parser.set_defaults(output_is_folder=True)
