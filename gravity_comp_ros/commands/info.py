"""`gravity_comp info`: joints, speeds and coverage of recordings, facts, and missing motion."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import replace

from gravity_comp_ros.api.arm_facts import arm_facts
from gravity_comp_ros.api.read import joined, read_each
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import known_arm, KnownArm, LearnOptions, MIN_SLOW_SAMPLES
from gravity_comp_ros.commands import next_step
from gravity_comp_ros.commands.arguments import axes_options, gate, read_options
from gravity_comp_ros.commands.terminal import (
    answer, command, progress, show, styled, table)
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.facts.fact import Action, Fact, Kind, refused
from gravity_comp_ros.facts.motion import describe, MOTION, RecordingFacts
from gravity_comp_ros.planning.enough import Enough, enough_motion
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.bag import ReadReport

_COLOURS = {Action.NOTED: 'yellow', Action.CORRECTED: 'green', Action.LEFT_OUT: 'green',
            Action.REFUSED: 'red'}


def run(args: argparse.Namespace) -> int:
    options = replace(read_options(args), refuse=False)
    slow = gate(args) or GateOptions()
    with progress() as report:
        recordings = read_each(args.bags, options, report)
        facts = []
        for each in recordings:
            data = Recording(each.samples, slow, (each.report,))
            arm = known_arm(data, LearnOptions(axes=axes_options(args),
                                               ordered=args.joints is not None))
            more = arm_facts(data, arm)
            facts.append((replace(each.report, facts=(*each.report.facts, *more)),
                          describe(each.samples, slow)))
        # Reports bags of different robots, which a fit would reject.
        together = arm.of(joined(recordings, slow))
        refusals = [fact for each, _ in facts for fact in refused(each.facts)]
        enough = _enough(together, arm, refusals)

    def show_all() -> None:
        for each in facts:
            _show(*each)
        if enough is not None and (missing := enough.facts()):
            _show_facts(missing)
            show('')
        _show_next_step(args, facts, refusals)

    answer(args, {'recordings': [_to_json(*each) for each in facts],
                  'motion': None if enough is None else enough.to_json()}, show_all)
    return 0


def _enough(recording: Recording, arm: KnownArm, refusals: list[Fact]) -> Enough | None:
    """Return the sufficiency of the motion; None if the effort is no torque, or no joint moves."""
    if any(fact.kind is not Kind.EFFORT_SIGN for fact in refusals):
        return None
    try:
        return enough_motion(recording.samples, arm.axes.geometry)
    except FitError:
        return None


def _to_json(report: ReadReport, facts: RecordingFacts) -> dict[str, object]:
    every = [fact.to_json() for fact in (*report.facts, *facts.motion)]
    return {'path': str(report.path), **report.to_json(), **facts.to_json(), 'facts': every}


def _show_next_step(args: argparse.Namespace, recordings: list[tuple[ReadReport, RecordingFacts]],
                    refusals: list[Fact]) -> None:
    """Show the command of the fit, with inverted effort where friction has the wrong sign."""
    other = [fact for fact in refusals if fact.kind is not Kind.EFFORT_SIGN]
    if other:
        next_step.show('correct what is refused above; `fit` refuses it too')
        return
    inverted = {name for fact in refusals for name in fact.joints}
    why = 'learn gravity' + ', with the sign of the effort inverted' * bool(inverted)
    if sum(facts.kept for _, facts in recordings) < MIN_SLOW_SAMPLES:
        why += '; the gate keeps few samples, so that `fit` uses all'
    if inverted:
        args = argparse.Namespace(**{**vars(args), 'effort_scale': _scales(
            recordings[0][0], inverted)})
    next_step.show(why, next_step.command('fit', args, '-o', next_step.new_name()))
    has_unit = any(fact.kind is Kind.EFFORT_UNIT for report, _ in recordings
                   for fact in report.facts)
    if not has_unit and not any(report.effort_scale for report, _ in recordings):
        show('The unit of effort cannot be checked by a recording alone: N·cm or mN·m of this '
             'size look like N·m of a heavier arm. To compare with the masses of a description:',
             command(next_step.command('check', args, '--urdf', str(args.urdf or 'robot.urdf'))))


def _scales(report: ReadReport, inverted: set[str]) -> dict[str, float]:
    """Return --effort-scale by joint as given, with the opposite sign for `inverted` joints."""
    names = list(dict.fromkeys([*report.effort_scale, *sorted(inverted)]))
    unit = replace(report.options, effort_scale={}).scale(names)
    return {name: report.effort_scale.get(name, 1.0) / unit[name]
            * (-1.0 if name in inverted else 1.0) for name in names}


def _show(report: ReadReport, facts: RecordingFacts) -> None:
    show(styled('bold', str(report.path), f'  topic {report.topic}'),
         f'{counted(report.n_samples, "sample")} at {report.rate_hz:.4g} Hz over '
         f'{report.duration_s:.4g} s, velocity {report.velocity}')
    if report.dropped:
        dropped = ', '.join(f'{count} {reason}' for reason, count in report.dropped.items())
        show(f'dropped {sum(report.dropped.values())} of {counted(report.n_messages, "message")}: '
             f'{dropped}')
    show(f'slow samples {100 * facts.slow_share:.1f} %, kept by the slow-motion gate {facts.kept}')
    show(table('', ('joint', *MOTION), [(name, *joint.cells())
                                        for name, joint in facts.joints.items()]))
    show(*(styled('yellow', '  •', f' {line}') for line in report.file_notes))
    _show_facts((*report.facts, *facts.motion))
    show('')


def _show_facts(facts: Iterable[Fact]) -> None:
    for fact in facts:
        word = 'refused: ' * (fact.action is Action.REFUSED)
        show(styled(_COLOURS[fact.action], '  •', f' {word}{fact.sentence}'))
