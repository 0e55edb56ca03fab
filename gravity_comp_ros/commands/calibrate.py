"""
Calibrate efforts in N·m with a known weight, or the stiffness of servos.

A known weight gives the torque in N·m per unit of effort of every joint that it loads, for a
driver that publishes currents or uncalibrated torques. No mass of the arm is needed; the link
lengths come from the URDF.

With --goals one recording gives the stiffness of position-controlled servos, for the parameter
servo_stiffness of the node: the torque of --model by the angle between goal and position.

which recordings: two of slow motion, without and with the weight, over most of the range of each
joint. The heavier the weight and the wider the motion, the smaller the intervals.

For example:
  gravity_comp calibrate empty.mcap loaded.mcap --mass 2.0 --urdf robot.urdf
  gravity_comp calibrate empty.mcap loaded.mcap --mass 2.0 --com 0 0 0.08 --link tool0
                                                    weight with a known centre, on tool0
  gravity_comp calibrate run1.mcap --goals /joint_goals --model arm.json
                                                    stiffness of servos
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from gravity_comp_ros.api.read import joined, read_each, read_recording
from gravity_comp_ros.calibration.known_weight import (
    calibrate, CalibrationOptions, Weight)
from gravity_comp_ros.calibration.servo_stiffness import held_goals, servo_stiffness
from gravity_comp_ros.commands import arguments, reading, terminal
from gravity_comp_ros.commands.terminal import Answer
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.export.payload_lines import millimetres
from gravity_comp_ros.models.applied_effects import Quantity
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.bag import joint_goals


def add_arguments(parser: argparse.ArgumentParser) -> None:
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
    arguments.add_urdf(parser, 'axes and link lengths')
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)


def run(args: argparse.Namespace) -> Answer:
    """Calibrate efforts or servos, and show the option that applies the result."""
    if args.goals is not None:
        return _stiffness(args)
    if args.loaded is None or args.mass is None or args.model is not None:
        args.parser.error('name LOADED and --mass for efforts, or --goals and --model for servos')
    if args.empty.resolve() == args.loaded.resolve():
        raise OptionError(f'{args.empty} is named as the recording without and with the weight')
    options, slow = arguments.read_options(args), arguments.gate(args)
    if slow is not None and args.rate is None:
        slow = replace(slow, rate_hz=None)
    with terminal.progress() as report:
        empty, loaded = (joined([run], slow) for run in read_each(
            (args.empty, args.loaded), options, report))
        reports = (*empty.reports, *loaded.reports)
        arm = reading.described_in(args, replace(empty, reports=reports))
        weight = Weight(args.link or arm.geometry.link, args.mass,
                        None if args.com is None else tuple(args.com))
        joints = arm.geometry.joints
        result = calibrate(empty.select_joints(joints).slow, loaded.select_joints(joints).slow,
                           arm, weight, CalibrationOptions(same_offset=args.same_zero))
    # Relative to the scales with which the recordings were read.
    scales = {joint: scale.times(empty.reports[0].effort_scale.get(joint, 1.0))
              for joint, scale in result.scales.items()}
    option = '--effort-scale ' + ','.join(f'{joint}={scale.value:.5g}'
                                          for joint, scale in scales.items())
    document = {
        'joints': {joint: {'scale': scale, 'load_rms': result.load[joint],
                           'rmse': result.rmse[joint]} for joint, scale in scales.items()},
        'left_out': result.left_out, 'option': option, 'link': weight.link, 'mass': weight.mass,
        'centre': result.centre,
        'bags': [each.to_json() for each in reports]}
    centre = [] if weight.centre is not None else [
        f'centre of mass of the weight in the frame of {weight.link}: '
        f'{millimetres(result.centre)}']
    return Answer(document, [
        *reading.bag_lines(reports), '', _table(scales, result.load), *centre,
        *(f'{joint} is not calibrated: {why}' for joint, why in result.left_out.items()),
        '', 'option for all verbs' + ', instead of --effort-unit' * (options.effort_unit != 'Nm')
        + ', and for the parameter effort_scale of the node:',
        terminal.command(option)])


def _stiffness(args: argparse.Namespace) -> Answer:
    """Find the stiffness of servos from goals and positions."""
    if args.model is None or args.loaded is not None or args.mass is not None:
        args.parser.error('--goals needs one recording and --model, and neither LOADED nor --mass')
    model = load_model(args.model)
    options = replace(arguments.read_options(args), joints=model.joints)
    with terminal.progress() as report:
        recording = read_recording([args.empty], options, arguments.gate(args), report)
        samples, (bag,) = recording.slow, recording.reports
        times, goals = joint_goals(args.empty, args.goals, model.joints, bag.options)
    result = servo_stiffness(model, samples, held_goals(
        samples.t + 1e-9 * bag.start_ns, times, goals))
    values = ', '.join(f'{result.stiffness[joint].value:.5g}' if joint in result.stiffness
                       else '1000000.0' for joint in model.joints)
    parameter = f'servo_stiffness: [{values}]'
    document = {
        'joints': {joint: {'stiffness': k, 'sag_rms': result.sag[joint],
                           'rmse': result.rmse[joint]} for joint, k in result.stiffness.items()},
        'left_out': result.left_out, 'option': parameter, 'model': args.model.name,
        'bags': [bag.to_json()]}
    table = TextTable(
        ('joint', 'N·m/rad', '95 %', 'sag, rad RMS', 'rest, rad RMS'),
        [(joint, f'{k.value:.4g}', f'{k.ci95[0]:.4g} … {k.ci95[1]:.4g}',
          f'{result.sag[joint]:.4f}', f'{result.rmse[joint]:.4f}')
         for joint, k in result.stiffness.items()])
    return Answer(document, [
        *reading.lines(recording), '', table,
        *(f'{joint} gets no offset: {why}' for joint, why in result.left_out.items()),
        '', 'parameter of the node:', terminal.command(parameter)])


def _table(scales: Mapping[str, Quantity], load: Mapping[str, float]) -> TextTable:
    return TextTable(('joint', 'N·m per unit', '95 %', '±', 'weight N·m RMS'), [
        (joint, f'{scale.value:.4g}', f'{scale.ci95[0]:.4g} … {scale.ci95[1]:.4g}',
         f'{100.0 * scale.half / abs(scale.value):.1f} %', f'{load[joint]:.3f}')
        for joint, scale in scales.items()])
