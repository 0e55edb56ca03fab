"""
Identify physical effects missing from a gravity model, with their size.

For example:
  gravity_comp diagnose run1.mcap run2.mcap --model arm.json
  gravity_comp diagnose run1.mcap                         without a model file
  gravity_comp diagnose run1.mcap --effects coulomb_friction,viscous_friction --json
  gravity_comp diagnose run1.mcap --model arm.json --html report.html    report with plots

which recordings: the fitted recordings and any others of the same arm with the same payload, slow
or fast. More runs resolve more findings; errors are always held-out errors.

The effects were selected jointly: add all that the printed command names. An ambiguous effect is
added with its alternatives: their sum is predicted, not their split. Verdicts: docs/diagnosis.md.

All samples are used, including fast ones, because inertia is one of the effects. Errors are
held-out errors relative to the range of the measured torque (Yu 2022, Eq. 16).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
import time

from gravity_comp_ros.api.axes import ArmOptions
from gravity_comp_ros.api.steps import diagnose_recording
from gravity_comp_ros.commands import arguments, html, next_step, reading, terminal
from gravity_comp_ros.commands.terminal import Answer
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding, FOUND
from gravity_comp_ros.effects.registry import broken_plug_ins, known_effect
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.evaluation.compare import compare
from gravity_comp_ros.facts.motion import describe
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.bag import ReadReport

_WHY_OPEN = {
    'ambiguous': 'an alternative explains the data equally well; together they predict the sum',
    'weak': 'too small, uncertain or not physical: do not add',
    'untestable': 'not identifiable with this motion: do not add',
    'unexplained': 'no known effect describes it',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `diagnose`."""
    arguments.add_model(parser, 'model file, written by `fit` (default: a model is fitted)',
                        required=False)
    parser.add_argument('--effects', metavar='A,B,...', type=arguments.joint_list,
                        help='test these effects only (default: all known effects)')
    arguments.add_urdf(parser, f'{arguments.DRAWN}; without --model, also the joint axes',
                       fixed=False)
    arguments.add_bags(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)
    arguments.add_page(parser)


def run(args: argparse.Namespace) -> Answer:
    """Read, diagnose and show."""
    html.check_libraries(args)
    for name in args.effects or ():  # before the bags are read
        known_effect(name)
    model = _model(args)
    started = time.perf_counter()
    with terminal.progress() as report:
        recording = replace(reading.load(args, report, is_gated=False), gate=GateOptions())
        learning = ArmOptions(urdf=args.urdf, ordered=args.joints is not None)
        diagnosed = diagnose_recording(recording, model, args.effects, learning, report,
                                       fits=bool(args.html))
    recording, reports = diagnosed.recording, diagnosed.recording.reports
    diagnosis = replace(diagnosed.diagnosis, findings=tuple(
        replace(f, next_step=f.next_step or f.effect and _add(
            args, [target(f.effect, f.joint)], args.model or 'MODEL.json') or '')
        for f in diagnosed.diagnosis.findings))
    samples = recording.used.joints(tuple(diagnosis.joints))
    if args.html:
        _write_page(args, samples, diagnosed.model, diagnosis, reports, fitted=model is None)
    motion, seconds = describe(samples), time.perf_counter() - started
    held = (f'{len(recording.samples) - len(samples)} samples that were held out of the fit are '
            f'excluded, for `compare --holdout`')
    applied = ', '.join(effect.target for effect in model.applied.effects) if model else ''
    findings = diagnosis.table()
    lines = [terminal.styled('bold', wording.verdict(diagnosis)), '',
             *reading.bag_lines(reports), *reading.fitted_lines(model, reports),
             *([] if recording.use is None else [held]),
             *([f'the model already includes {applied}'] if applied else []), '',
             reading.motion_table(f'recording: {motion.n_samples} samples', motion),
             *([replace(findings, title='missing effects')] if findings.rows else []),
             *next_steps(args, diagnosis),
             *terminal.bullets('yellow', motion.remarks),
             *terminal.section('not identifiable from this recording',
                               wording.untestable(diagnosis)),
             '', f'diagnosed in {seconds:.1f} s']
    document = {
        **diagnosis.to_json(), 'model': args.model.name if args.model else None,
        'data': {**motion.to_json(), 'n_samples': motion.n_samples},
        'facts': [fact.to_json() for fact in diagnosed.facts],
        'bags': [r.to_json() for r in reports],
        'left_out_plug_ins': list(broken_plug_ins()), 'seconds': seconds}
    return Answer(document, lines, [
        *(fact.sentence for fact in diagnosed.facts),
        *(reading.scale_warnings(model, reports) if model else []), *broken_plug_ins()])


def _write_page(args: argparse.Namespace, samples: JointSamples, model: GravityModel | None,
                diagnosis: Diagnosis, reports: tuple[ReadReport, ...], fitted: bool) -> None:
    assert model is not None
    notes = ('Predictions are of a gravity model fitted for this report to '
             f'{model.coverage.n_samples} samples.',) if fitted else ()
    compared = f'all {samples.n_samples} samples, including fast ones'
    commands = _add_commands(args, diagnosis.to_add)
    html.write_report(args, model, samples, compare(model, samples), compared, reports, notes,
                      diagnosis=diagnosis, next_command='\n'.join(commands))


def _model(args: argparse.Namespace) -> GravityModel | None:
    if args.model is None:
        return None
    model = load_model(args.model)
    if args.joints is not None and set(args.joints) != set(model.joints):
        raise OptionError('--joints: the joints are those of the model '
                          f'({", ".join(model.joints)}); omit --joints')
    # The bag may contain other joints, such as a gripper.
    args.joints = model.joints
    return model


def next_steps(args: argparse.Namespace, diagnosis: Diagnosis) -> list[terminal.Line]:
    """Return the next commands, with this call's file names, and the open findings."""
    to_add, lines = diagnosis.to_add, list[terminal.Line]()
    open_ = [f for f in diagnosis.findings if f.verdict not in FOUND]
    if to_add:
        effects = 'the effect' if len(to_add) == 1 else f'all {len(to_add)} effects together'
        lines = next_step.lines(f'add {effects}', *_add_commands(args, to_add))
    elif not diagnosis.findings and args.model is not None:
        lines = next_step.lines('nothing to add; plot measured and predicted torque',
                                next_step.command('replay', args, '-o', 'replay.mcap',
                                                  model=args.model, bags=args.bags[:1]))
    return [*lines, *(_open_lines(args, open_) if open_ else []), '']


def _add_commands(args: argparse.Namespace, targets: Sequence[str]) -> list[str]:
    """Return the command lines that add effects, preceded by a fit if there is no model."""
    if not targets:
        return []
    model = args.model or next_step.new_name()
    return [*_fit_command(args, model), _add(args, targets, model)]


def _add(args: argparse.Namespace, targets: Sequence[str], model: Path | str) -> str:
    bags = [Path(','.join(targets)), *args.bags]   # effects come before the bags
    return next_step.command('add', args, bags=bags, model=model)


def _fit_command(args: argparse.Namespace, model: Path | str) -> list[str]:
    """Return the command that fits the model, if the user named none."""
    return [] if args.model is not None else [next_step.command('fit', args, '-o', str(model))]


def _open_lines(args: argparse.Namespace, findings: Sequence[Finding]) -> list[terminal.Line]:
    """Return lines on open findings, their alternatives and their motion."""
    lines = []
    for finding in findings:
        lines.append(f'{finding.effect or "unknown"} on {wording.where(finding)}: '
                     f'{finding.verdict}, {_WHY_OPEN[finding.verdict]}')
        if finding.rivals:
            lines.append(f'  alternative: {", ".join(finding.rivals)}, with similar evidence')
        if finding.next_step:
            lines.append(f'  to resolve it: {finding.next_step}')
    result = terminal.section(f'open: {counted(len(findings), "finding")}', lines)
    if any(f.next_step and f.effect is not None for f in findings):
        model = args.model or next_step.new_name()
        result += next_step.lines(
            'plan the motion that resolves them, record it, and diagnose all recordings together',
            *_fit_command(args, model), next_step.command(
                'plan', args, '-o', next_step.new_name('motion', 'yaml'), model=model))
    return result
