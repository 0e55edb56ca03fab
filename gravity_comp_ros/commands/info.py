"""
List joints, speeds and coverage of a recording, and its limitations.

columns of the table:
  range      minimum and maximum angle, in rad
  travel     distance from minimum to maximum angle, in rad
  rms, max   speed in rad/s; the slow-motion gate requires all joints slow at the same time
  reversals  changes of direction; they excite friction
  effort     minimum and maximum, in N·m (or in the unit of the driver)

For example:
  gravity_comp info run1.mcap
  gravity_comp info rosbag2_folder/ old.db3 --max-speed 0.2
  gravity_comp info run1.mcap --json
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from gravity_comp_ros.api.axes import known_arm, KnownArm, NO_DESCRIPTION
from gravity_comp_ros.api.read import arm_facts, joined, read_each
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import with_enough_motion
from gravity_comp_ros.commands import arguments, next_step, reading, terminal
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.facts.fact import Action, Fact, Kind, refused
from gravity_comp_ros.facts.motion import describe, RecordingFacts
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.bag import ReadReport
from gravity_comp_ros.recordings.cleaning import listed

if TYPE_CHECKING:
    from gravity_comp_ros.planning.enough import Enough

_COLOURS = {Action.NOTED: 'yellow', Action.CORRECTED: 'green', Action.LEFT_OUT: 'green',
            Action.REFUSED: 'red'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `info`."""
    arguments.add_urdf(parser, 'axes to compare the directions and zeros of the joints with',
                       or_none=True)
    arguments.add_bags(parser)
    arguments.add_reading(parser)
    arguments.add_gate(parser)
    arguments.add_json(parser)


def run(args: argparse.Namespace) -> terminal.Answer:
    options = replace(arguments.read_options(args), refuse=False)
    slow = arguments.gate(args) or GateOptions()
    with terminal.progress() as progress:
        recordings = read_each(args.bags, options, progress)
        facts = []
        # Reports bags of different robots, which a fit would reject.
        together = joined(recordings, slow)
        arm = known_arm(together, arguments.arm_options(args))
        for each in recordings:
            own = arm_facts(Recording(each.samples, slow, (each.report,)), arm, refuse=False)
            facts.append((replace(each.report, facts=(*each.report.facts, *own)),
                          describe(each.samples, slow)))
        together = arm.of(together)
        refusals = [fact for each, _ in facts for fact in refused(each.facts)]
        enough = _enough(together, arm, refusals)
    missing = [] if enough is None else enough.facts()
    return terminal.Answer(
        {'recordings': [
            {'path': str(report.path), **report.to_json(), **motion.to_json(),
             'facts': [fact.to_json() for fact in (*report.facts, *motion.motion)]}
            for report, motion in facts],
         'motion': None if enough is None else enough.to_json()},
        [*(line for each in facts for line in _lines(*each)),
         *([*map(_fact_line, missing), ''] if missing else []),
         *_next_step(args, facts, refusals, bool(with_enough_motion(together).ungated))])


def _enough(recording: Recording, arm: KnownArm, refusals: list[Fact]) -> Enough | None:
    """Return the sufficiency of the motion; None if the effort is no torque, or no joint moves."""
    if any(fact.kind is not Kind.EFFORT_SIGN for fact in refusals):
        return None
    from gravity_comp_ros.planning.enough import enough_motion  # imports SciPy
    try:
        return enough_motion(recording.samples, arm.geometry)
    except FitError:
        return None


def _next_step(args: argparse.Namespace, recordings: list[tuple[ReadReport, RecordingFacts]],
               refusals: list[Fact], ungated: bool) -> list[terminal.Line]:
    """Return the command of the fit, with inverted effort where friction has the wrong sign."""
    other = [fact for fact in refusals if fact.kind is not Kind.EFFORT_SIGN]
    if other:
        return next_step.lines('correct what is refused above; `fit` refuses it too')
    inverted = {name for fact in refusals for name in fact.joints}
    why = 'learn gravity' + ', with the sign of the effort inverted' * bool(inverted)
    if ungated:
        why += '; few samples are slow, so that `fit` uses all'
    if inverted:
        args = argparse.Namespace(**{**vars(args), 'effort_scale': _scales(
            recordings[0][0], inverted)})
    lines = next_step.lines(why, next_step.command('fit', args, '-o', next_step.new_name()))
    has_unit = any(fact.kind is Kind.EFFORT_UNIT for report, _ in recordings
                   for fact in report.facts)
    other_urdf = ['--urdf', 'robot.urdf'] if args.urdf in (None, NO_DESCRIPTION) else []
    if not has_unit and not any(report.effort_scale for report, _ in recordings):
        lines += ['The unit of effort cannot be checked by a recording alone: N·cm or mN·m of '
                  'this size look like N·m of a heavier arm. To compare with the masses of a '
                  'description:', terminal.command(next_step.command(
                      'check', args, *other_urdf))]
    return lines


def _scales(report: ReadReport, inverted: set[str]) -> dict[str, float]:
    """Return --effort-scale by joint as given, with the opposite sign for `inverted` joints."""
    names = list(dict.fromkeys([*report.effort_scale, *sorted(inverted)]))
    unit = replace(report.options, effort_scale={}).scale(names)
    return {name: report.effort_scale.get(name, 1.0) / unit[name]
            * (-1.0 if name in inverted else 1.0) for name in names}


def _lines(report: ReadReport, facts: RecordingFacts) -> list[terminal.Line]:
    dropped = [f'dropped {sum(report.dropped.values())} of '
               f'{counted(report.n_messages, "message")}: {listed(report.dropped)}']
    return [
        terminal.styled('bold', str(report.path), f'  topic {report.topic}'),
        f'{counted(report.n_samples, "sample")} at {report.rate_hz:.4g} Hz over '
        f'{report.duration_s:.4g} s, velocity {report.velocity}',
        *(dropped if report.dropped else []),
        f'slow samples {100 * facts.slow_share:.1f} %, kept by the slow-motion gate {facts.kept}',
        reading.motion_table('', facts), *terminal.bullets('yellow', report.file_notes),
        *map(_fact_line, (*report.facts, *facts.motion)), '']


def _fact_line(fact: Fact) -> terminal.Line:
    word = 'refused: ' * (fact.action is Action.REFUSED)
    return terminal.bullets(_COLOURS[fact.action], [word + fact.sentence])[0]
