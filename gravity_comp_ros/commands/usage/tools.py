"""Arguments of the verbs for descriptions, exports, fleets and the browser."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from gravity_comp_ros.commands import arguments


@arguments.verb('check a robot description against recorded torque, for faults', """\
Is this description that of the recorded arm? Compared are: axes reversed or turned, zero angles,
joints exchanged, the mount of the base, factors and signs of efforts, masses, and bodies that the
description has not. Every fault is one sentence, the worst first, with the line of the
description or the option that corrects it. What the motion does not show is listed too.

which recordings: slow motion of all joints over tens of degrees, without contact.

examples:
  gravity_comp check run1.mcap run2.mcap --urdf robot.urdf
  gravity_comp check run1.mcap --urdf robot.urdf --html check.html

exit status: 0 no fault, 3 faults (for tests of a robot's software), 1 failed, 2 wrong usage.
""", arguments.add_bags, arguments.add_gate, arguments.add_reading, arguments.add_json)
def check(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `check`."""
    arguments.add_description(parser, 'description to check (default: /robot_description in the '
                              'recording)')
    arguments.add_page(parser, 'the faults with their corrections')


@arguments.verb('calibrate efforts in N·m with a known weight, or the stiffness of servos', """\
A known weight gives the torque in N·m per unit of effort of every joint that it loads, for a
driver that publishes currents or uncalibrated torques. No mass of the arm is needed; the link
lengths come from the URDF.

With --goals one recording gives the stiffness of position-controlled servos, for the parameter
servo_stiffness of the node: the torque of --model by the angle between goal and position.

which recordings: two of slow motion, without and with the weight, over most of the range of each
joint. The heavier the weight and the wider the motion, the smaller the intervals.

examples:
  gravity_comp calibrate empty.mcap loaded.mcap --mass 2.0 --urdf robot.urdf
  gravity_comp calibrate empty.mcap loaded.mcap --mass 2.0 --com 0 0 0.08 --link tool0
                                                    weight with a known centre, on tool0
  gravity_comp calibrate run1.mcap --goals /joint_goals --model arm.json
                                                    stiffness of servos
""", arguments.add_gate, arguments.add_reading, arguments.add_json)
def calibrate(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `calibrate`."""
    parser.add_argument('empty', metavar='EMPTY', type=Path, help='recording without the weight')
    parser.add_argument('loaded', metavar='LOADED', type=Path, nargs='?',
                        help='recording with the weight')
    parser.add_argument('--mass', metavar='KG', type=arguments.positive,
                        help='mass of the weight')
    parser.add_argument('--goals', metavar='TOPIC',
                        help='stiffness of servos: JointState topic of EMPTY with the goals')
    arguments.add_model(parser, 'with --goals: gravity model of the arm', required=False)
    parser.add_argument('--com', metavar=('X', 'Y', 'Z'), type=arguments.finite, nargs=3,
                        help='centre of mass of the weight in the frame of --link, '
                        'm (default: estimated)')
    parser.add_argument('--link', metavar='LINK',
                        help='link that carries the weight (default: that of the last joint)')
    parser.add_argument('--same-zero', action='store_true',
                        help='the torque sensors kept their zero between the recordings, without '
                        'a restart: one offset for both, and smaller intervals')
    arguments.add_description(parser, 'axes and link lengths (default: /robot_description in a '
                              'recording)')


@arguments.verb('write a model as C source, into a URDF or MJCF, or as payload of a drive', """\
targets:
  c         one C99 header and source in the folder -o, for a controller without Python
            (docs/realtime.md)
  urdf      the file --urdf with the masses and centres of mass nearest to its own that give the
            gravity torque of the model; Coulomb and viscous friction as <dynamics>
  mjcf      the same for a MuJoCo file, --mjcf
  payload   mass and centre of mass of the last `update --urdf`, as lines for the drives of UR,
            Franka, KUKA, xArm and Kinova; in the frame --flange of --urdf

Inertias about the centres of mass, axes and zero angles stay those of the description. Comments
and layout of the file stay byte for byte.

examples:
  gravity_comp export arm.json --to c -o src/
  gravity_comp export left.json --to c --prefix left -o src/    two arms in one program
  gravity_comp export arm.json --to urdf --urdf robot.urdf -o corrected.urdf
  gravity_comp export arm.json --to mjcf --mjcf scene.xml -o corrected.xml
  gravity_comp export tool.json --to payload --urdf robot.urdf --flange tool0
""", arguments.add_json)
def export(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `export`."""
    parser.add_argument('model', metavar='MODEL.json', type=Path, help='model to export')
    parser.add_argument('--to', choices=('c', 'urdf', 'mjcf', 'payload'), required=True,
                        help='target, see below')
    parser.add_argument('-o', '--output', metavar='PATH', type=Path,
                        help='folder (c, created if missing) or file (urdf, mjcf) to write')
    parser.add_argument('--prefix', metavar='NAME',
                        help='c: prefix of all names and files (default: gc)')
    arguments.add_description(parser, 'urdf: description to correct; payload: description with '
                              'the flange')
    parser.add_argument('--mjcf', metavar='FILE.xml', type=Path,
                        help='mjcf: description to correct')
    parser.add_argument('--flange', metavar='LINK',
                        help='payload: link of --urdf whose frame the drive uses, such as tool0 '
                        '(default: the link of the last joint)')
    parser.set_defaults(output_is_folder=True)


@arguments.verb('fit or diagnose every robot of a folder, locally or on a Dask cluster', """\
examples:
  gravity_comp fleet fit recordings/ -o models/          recordings/ROBOT/*.mcap
  gravity_comp fleet diagnose recordings/ --models models/ -o findings/
  gravity_comp fleet fit recordings/ -o models/ --workers 8
  gravity_comp fleet fit /nfs/recordings -o models/ --scheduler tls://10.0.0.5:8786

Each subfolder contains the bags of one robot. A bag or robot that fails is reported and omitted.
After an interruption the same command resumes; after new bags it processes only what changed.
A Dask cluster requires the bags under the same path and this package of the same version. A
program that reaches a scheduler tcp://... can run code on its workers and here; docs/fleet.md
describes TLS.
""", arguments.add_reading, arguments.add_json)
def fleet(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fleet`."""
    parser.add_argument('what', choices=('fit', 'diagnose'), help='operation for each robot')
    parser.add_argument('folder', metavar='FOLDER', type=Path,
                        help='folder with one subfolder of bags for each robot')
    parser.add_argument('-o', '--output', metavar='FOLDER', type=Path, required=True,
                        help='output folder: ROBOT.json, ROBOT.diagnosis.json')
    where = parser.add_mutually_exclusive_group()
    where.add_argument('--workers', metavar='N', type=arguments.count, default=os.cpu_count() or 1,
                       help='processes on this machine (default: one per core)')
    where.add_argument('--scheduler', metavar='ADDRESS',
                       help='Dask scheduler, e.g. tls://10.0.0.5:8786')
    parser.add_argument('--formulation', choices=arguments.FORMULATIONS,
                        default=arguments.FORMULATIONS[0],
                        help='formulation of `fit` (default: %(default)s)')
    parser.add_argument('--models', metavar='FOLDER', type=Path,
                        help='`diagnose` uses FOLDER/ROBOT.json (default: models are fitted)')
    parser.add_argument('--effects', metavar='A,B,...', type=arguments.joint_list,
                        help='`diagnose` tests these effects only (default: all)')
    arguments.add_gate(parser, 'slow-motion gate of `fit`')
    parser.set_defaults(output_is_folder=True)


@arguments.verb('compare, diagnose, add effects and undo, in a browser', """\
examples:
  gravity_comp workbench run1.mcap run2.mcap
  gravity_comp workbench run1.mcap --model arm.json --model before.json     compare two models
  gravity_comp workbench run1.mcap --no-browser --port 5010

The page is served to this machine only, unless --host is given. Sessions are saved continuously
(~/.local/state/gravity_comp/workbench) and can be resumed; --forget saves none. Stop the server
with Ctrl-C.
""", arguments.add_bags, arguments.add_reading)
def workbench(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `workbench`."""
    parser.add_argument('--model', metavar='MODEL.json', type=Path, action='append', default=[],
                        help='initial model, written by `fit`; further models for comparison '
                        '(default: a model is fitted)')
    parser.add_argument('--formulation', choices=arguments.FORMULATIONS,
                        help='formulation of the first fit (default: auto; chain with --urdf)')
    parser.add_argument('--host', default='127.0.0.1',
                        help='address to serve on; other machines can then reach it (default: '
                        '%(default)s)')
    parser.add_argument('--port', default=5006, type=arguments.number(
        int, 'a port (0 to 65535)', lambda value: 0 <= value <= 65535),
                        help='0 for any free port (default: %(default)s)')
    parser.add_argument('--no-browser', action='store_true', help='do not open a browser window')
    parser.add_argument('--forget', action='store_true',
                        help='save no session on disk, and list none')
    arguments.add_gate(parser, 'samples for the fit and the errors of gravity')
    arguments.add_description(parser, f'{arguments.DRAWN}; also the joint axes of fitted models',
                              fixed=False)


@arguments.verb('print a shell completion script for verbs, options and files', """\
examples:
  gravity_comp completion bash > ~/.local/share/bash-completion/completions/gravity_comp
  gravity_comp completion zsh > ~/.zfunc/_gravity_comp        with ~/.zfunc in fpath

The script lists the options of this release: write it again after an upgrade. Completion does not
start Python.
""")
def completion(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `completion`."""
    parser.add_argument('shell', choices=('bash', 'zsh', 'tcsh'), help='target shell')
