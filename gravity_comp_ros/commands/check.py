"""`gravity_comp check`: faults of a robot description, from recorded torque."""

from __future__ import annotations

import argparse

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.commands import html, reading, terminal
from gravity_comp_ros.description.links import urdf_inertials
from gravity_comp_ros.description.robot_tree import parse_tree
from gravity_comp_ros.description_check.check import check_description, DescriptionCheck
from gravity_comp_ros.description_check.sentences import (
    error_rows, Finding, findings, unchecked_sentences)
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.report.check_page import check_html

EXIT_FAULTS = 3


@html.with_error_page('check_page')
def run(args: argparse.Namespace) -> int:
    """Check the description, and show its faults."""
    with terminal.progress() as report:
        recording = reading.load(args, report)
        text, source, arm = reading.described(args, recording)
        report('check', 0.5)
        slow = recording.select_joints(arm.geometry.joints).slow
        inertials = urdf_inertials(text, arm, source)
        result = check_description(slow, arm, inertials)
        faults = findings(result, arm, parse_tree(text, source), inertials)
        report('check', 1.0)
    unchecked = unchecked_sentences(result)
    if args.html is not None:
        page = check_html(source, result, faults, unchecked, arm, slow.q[len(slow) // 2])
        write_atomically(args.html, page.encode(), error=GravityCompError)
    document = {
        'description': source, 'faults': [one.to_json() for one in faults],
        'joints': {joint: {'rmse': before, 'rmse_corrected': after, 'torque_rms': torque}
                   for joint, before, after, torque in zip(
                       result.joints, result.before, result.after, result.torque)},
        'unchecked': unchecked, **recording.to_json()}
    terminal.answer(args, document,
                    lambda: _show(recording, source, result, faults, unchecked))
    return EXIT_FAULTS if faults else 0


def _show(recording: Recording, source: str, result: DescriptionCheck, faults: list[Finding],
          unchecked: list[str]) -> None:
    terminal.show(*reading.lines(recording), '')
    if not faults:
        terminal.show(f'{source}: no fault found')
    for number, one in enumerate(faults, start=1):
        terminal.show(f'{number}. {one.sentence}', terminal.command(one.correction),
                      *(f'   or, as probable: {other}' for other in one.alternatives))
    columns = ('joint', 'torque RMS N·m', 'RMSE as described', 'corrected')
    terminal.show('', terminal.table('', columns, error_rows(result)), *unchecked)
