"""
Check a robot description against recorded torque, for faults.

Is this description that of the recorded arm? Compared are: axes reversed or turned, zero angles,
joints exchanged, the mount of the base, factors and signs of efforts, masses, and bodies that the
description has not. Every fault is one sentence, the worst first, with the line of the
description or the option that corrects it. What the motion does not show is listed too.

which recordings: slow motion of all joints over tens of degrees, without contact.

For example:
  gravity_comp check run1.mcap run2.mcap --urdf robot.urdf
  gravity_comp check run1.mcap --urdf robot.urdf --html check.html

exit status: 0 no fault, 3 faults (for tests of a robot's software), 1 failed, 2 wrong usage.
"""

from __future__ import annotations

import argparse

from gravity_comp_ros.commands import arguments, html, reading, terminal
from gravity_comp_ros.description_check.check import check_description
from gravity_comp_ros.description_check.sentences import (
    error_rows, findings, unchecked_sentences)
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.printable import counted

EXIT_FAULTS = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `check`."""
    arguments.add_urdf(parser, 'description to check')
    arguments.add_page(parser, 'the faults with their corrections')
    arguments.add_bags(parser)
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)


def run(args: argparse.Namespace) -> terminal.Answer:
    """Check the description, and show its faults."""
    with terminal.progress() as report:
        recording = reading.load(args, report)
        arm = reading.described_in(args, recording)
        report('check', 0.5)
        slow = recording.select_joints(arm.geometry.joints).slow
        result = check_description(slow, arm)
        faults = findings(result, arm, recording.reports[0].options.effort_scale)
        report('check', 1.0)
    source = arm.tree.source
    unchecked = unchecked_sentences(result)
    document = {
        'description': source, 'faults': faults,
        'joints': {joint: {'rmse': before, 'rmse_corrected': after, 'torque_rms': torque}
                   for joint, before, after, torque in zip(
                       result.joints, result.before, result.after, result.torque)},
        'unchecked': unchecked, **recording.to_json()}
    lines: list[terminal.Line] = []
    for number, one in enumerate(faults, start=1):
        lines += [f'{number}. {one.sentence}', terminal.command(one.correction),
                  *(f'   or, as probable: {other}' for other in one.alternatives)]
    columns = ('joint', 'torque RMS N·m', 'RMSE as described', 'corrected')
    errors: list[terminal.Line] = [TextTable(columns, error_rows(result)), *unchecked]
    if args.html is not None:
        found = counted(len(faults), 'fault') if faults else 'no fault'
        html.write_lines(args.html, f'{source}: {found} found', [*lines, *errors])
    return terminal.Answer(document, [
        *reading.lines(recording), '', *lines,
        *([] if faults else [f'{source}: no fault found']), '', *errors],
        status=EXIT_FAULTS if faults else 0)
