"""Recordings, description and models of a verb, and the lines shown about them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gravity_comp_ros.api.axes import carried_in_motion, described
from gravity_comp_ros.api.read import read_recording
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.commands import arguments, terminal
from gravity_comp_ros.commands.terminal import Answer, ProgressCallback
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.description.links import described_arm, DescribedArm
from gravity_comp_ros.description.robot_tree import find_description, read_text
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.display import change, percent, TextTable
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.facts.motion import MOTION, RecordingFacts
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.history import now, undone
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.bag import ReadReport

if TYPE_CHECKING:
    from gravity_comp_ros.estimation.refit import Refit


def load(args: argparse.Namespace, report: ProgressCallback,
         is_gated: bool = True) -> Recording:
    """
    Return the recording of `args.bags`.

    :param is_gated: whether to apply the gate of the arguments; False for verbs that select
        samples themselves.
    :raises BagError: if a bag cannot be read.
    :raises ModelMismatchError: if two bags are of different robots.
    """
    gate = arguments.gate(args) if is_gated else None
    return read_recording(args.bags, arguments.read_options(args), gate, report)


def lines(recording: Recording, thinned: bool = True) -> list[str]:
    """
    Return plain lines on the bags and the gate; they may contain text from the bags.

    :param thinned: whether the rate of the gate applies; a fit uses slow samples at any rate.
    """
    if recording.gate is not None and not thinned:
        recording = replace(recording, gate=replace(recording.gate, rate_hz=None))
    return [*bag_lines(recording.reports), recording.gated.sentence()]


def bag_lines(reports: Sequence[ReadReport]) -> list[str]:
    """Return plain lines on the bags; they may contain text from the bags."""
    result = []
    for report in reports:
        result.append(
            f'{report.path.name}: {report.topic}, {counted(report.n_samples, "sample")} at '
            f'{report.rate_hz:.4g} Hz over {report.duration_s:.1f} s, '
            f'velocity {report.velocity}')
        result += [f'  dropped {count} of {counted(report.n_messages, "message")}: {reason}'
                   for reason, count in report.dropped.items() if count]
        result += [f'  {note}' for note in report.notes]
    return result


def motion_table(title: str, motion: RecordingFacts) -> TextTable:
    """Return the table of the ranges, speeds and efforts of the joints of a recording."""
    return TextTable(('joint', *MOTION), [
        (name, *joint.cells()) for name, joint in motion.joints.items()], title)


def fitted_names(model: GravityModel | None, reports: Sequence[ReadReport]) -> list[str]:
    """Return the names of those recordings that the model was fitted to."""
    known = {bag['sha256'] for bag in model.provenance.get('bags', ())} if model else set()
    return [report.path.name for report in reports if report.sha256 in known]


def fitted_lines(model: GravityModel | None, reports: Sequence[ReadReport]) -> list[str]:
    """Return a plain line on fitted and new recordings."""
    if model is None:
        return ['no --model: gravity is fitted jointly with the effects']
    old = fitted_names(model, reports)
    new = [report.path.name for report in reports if report.path.name not in old]
    parts = [f'fitted to {", ".join(old)}'] if old else []
    parts += [f'not fitted to {", ".join(new)}'] if new else []
    return [f'the model was {" and ".join(parts)}; errors are cross-validated, so fitted '
            'recordings are valid as well']


def scale_warnings(model: GravityModel, reports: Sequence[ReadReport]) -> list[str]:
    """Return a warning if the effort scales differ from those of the fit."""
    fitted: dict[str, float] = {}
    for bag in model.provenance.get('bags', ()):
        fitted.update({joint: bag['effort_scale'].get(joint, 1.0) for joint in model.joints})
    differ = sorted({joint for report in reports for joint, scale in fitted.items()
                     if report.effort_scale.get(joint, 1.0) != scale}, key=model.joints.index)
    if not differ:
        return []
    scales = ','.join(f'{joint}={fitted[joint]:g}' for joint in differ)
    return [f'the model was fitted with another effort scale of {", ".join(differ)}: '
            f'unless the driver has changed, use --effort-scale {scales}']


def described_in(args: argparse.Namespace, recording: Recording) -> DescribedArm:
    """
    Return the arm of the recorded joints in the description; others are held.

    :raises DataError: if there is none, or a joint that carries the arm moves.
    """
    description = find_description(args.urdf, [report.path for report in recording.reports])
    if description is None:
        raise DataError('no recording contains a robot description: name a file with '
                        '--urdf')
    reports = recording.reports
    arm = described(description, reports, *description.arm_joints(recording.joints), args.fixed)
    terminal.warn(*(f'joint {name} moves, and the arm carries it: its links are taken at rest, '
                    f'unless it is a joint of the arm (--joints)'
                    for name in carried_in_motion(arm, reports)))
    return arm


def arm_of_model(args: argparse.Namespace, model: GravityModel) -> DescribedArm:
    """Return the arm of a model as --urdf describes it, with the joints of --fixed held."""
    return described_arm(read_text(args.urdf), model.joints, str(args.urdf), args.fixed)


def fitted_gate(args: argparse.Namespace, model: GravityModel) -> GateOptions | None:
    """Return the gate of the arguments if they have one, else that of the fit of the model."""
    given, fitted = arguments.gate(args), model.provenance.get('gate')
    if fitted is None or args.all_samples or args.max_speed or args.rate:
        return given
    return None if fitted['all_samples'] else GateOptions(fitted['max_speed'], fitted['rate_hz'])


def undo(args: argparse.Namespace, model: GravityModel, output: Path) -> Answer:
    """
    Write the model before its last change, unless this is a dry run.

    :raises OptionError: if the model has no change to undo.
    """
    try:
        back = undone(model, now())
    except DataError as problem:
        raise OptionError(f'{args.model}: {problem}') from problem
    if not args.dry_run:
        save_model(output, back)
    effects, rest = back.history[-1].effects, [effect.target for effect in back.applied.effects]
    removed = 'would be removed from' if args.dry_run else 'removed from'
    return Answer({'model': str(output), 'removed': list(effects), 'effects': rest,
                   'written': not args.dry_run},
                  [f'{", ".join(effects)} {removed} {output}; remaining effects: '
                   f'{", ".join(rest) or "none"}'])


def refit_lines(result: Refit) -> list[terminal.Line]:
    """Return the size of the fit, the held-out errors, and added and omitted effects."""
    added = {effect.target: ', '.join(filter(None, (
        wording.coefficients(effect.coefficients, 6), wording.settings(effect))))
        for effect in result.model.applied.effects if effect.target in result.added}
    return [
        f'gravity and effects are fitted to {counted(result.n_samples, "sample")}',
        '', TextTable(
            ('joint', 'before', 'after', 'before', 'after', 'change'), [
                (name, f'{e.before:.4f}', f'{e.after:.4f}', percent(e.nrmse_before),
                 percent(e.nrmse_after), change(e.before, e.after))
                for name, e in result.errors.items()],
            'held-out error: N·m, and share of the torque range'),
        *(terminal.styled('bold', f'added {name}', f': {numbers}')
          for name, numbers in added.items()),
        *(f'omitted {name}: {why}' for name, why in result.skipped.items())]


def refit_warnings(result: Refit) -> list[str]:
    """Return warnings on a refit, with the command that undoes it."""
    lines = result.warnings()
    if not result.helps:
        lines[-1] += '; `gravity_comp add --undo` removes the addition'
    return lines
