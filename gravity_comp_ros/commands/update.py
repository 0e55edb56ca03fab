"""
Update a model after a payload change, from ten seconds of slow motion.

For example:
  gravity_comp update tool.mcap --model arm.json -o with_tool.json
  gravity_comp update tool.mcap --model arm.json --urdf robot.urdf -o with_tool.json
                                       also mass and centre of mass of the tool
  gravity_comp update tool.mcap --model arm.json        changes arm.json in place
  gravity_comp update --undo --model arm.json           restores it

which recordings: at least ten seconds of slow motion that rotates every joint by tens of degrees,
recorded with the new payload only. The model must be a chain or a potential; a chain
(`fit --formulation chain`) requires far fewer samples. With --urdf the new model is always a
chain. Effects of the model are kept unchanged.
"""

from __future__ import annotations

import argparse
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
import shlex
from typing import TYPE_CHECKING

from gravity_comp_ros.api.axes import known_arm, NO_DESCRIPTION
from gravity_comp_ros.api.steps import update_model
from gravity_comp_ros.commands import arguments, next_step, reading, terminal
from gravity_comp_ros.commands.terminal import Answer
from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.export.payload_lines import in_frame, load_of, millimetres
from gravity_comp_ros.models.gravity_model import GravityModel, UPDATED
from gravity_comp_ros.models.model_file import load_model, save_model

if TYPE_CHECKING:
    from gravity_comp_ros.estimation.update import UpdateResult
    from gravity_comp_ros.estimation.update_step import PayloadEstimate


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `update`."""
    arguments.add_bags(parser, nargs='*')
    arguments.add_model(parser, 'model of the arm before the payload change')
    parser.add_argument('-o', '--output', metavar='NEW.json', type=arguments.file_type('.json'),
                        help='model file to write (default: replaces the old model, which '
                        '--undo restores)')
    parser.add_argument('--undo', action='store_true',
                        help='undo the last update of the model; needs no bag')
    parser.add_argument('--dry-run', action='store_true', help='show the result, write nothing')
    arguments.add_urdf(parser, 'joint axes, for the mass and centre of mass of the payload',
                       or_none=True)
    parser.add_argument('--flange', metavar='LINK',
                        help='link of --urdf in whose frame the centre of mass is given, such as '
                        'tool0 (default: the link of the last joint)')
    arguments.add_reading(parser, joints=False)
    parser.set_defaults(in_place='model')
    arguments.add_gate(parser)
    arguments.add_json(parser)


def run(args: argparse.Namespace) -> Answer:
    """Update the model, show what changed, and write it."""
    if args.undo == bool(args.bags):
        args.parser.error('name at least one bag with the new payload, or give --undo alone')
    model = load_model(args.model)
    if args.flange is not None and args.urdf in (None, NO_DESCRIPTION):
        args.parser.error('--flange is a link of a description: name it with --urdf')
    target = args.output or args.model
    return _undo(args, model, target) if args.undo else _update(args, model, target)


def _undo(args: argparse.Namespace, model: GravityModel, target: Path) -> Answer:
    last = next((s for s in reversed(model.history) if s.previous is not None), None)
    if last is not None and last.action != UPDATED:
        raise OptionError(f'the last change of {args.model} is not an update but the addition of '
                          f'{", ".join(last.effects)} (`gravity_comp add --undo`)')
    answer = reading.undo(args, model, target)
    return replace(answer, document={**answer.document, 'undone': UPDATED})


def _update(args: argparse.Namespace, model: GravityModel, target: Path) -> Answer:
    args.joints = model.joints
    with terminal.progress() as report:
        recording = reading.load(args, report)
        report('update', 0.5)
        known = known_arm(recording, arguments.arm_options(args), model)
        arm = None
        if args.flange is not None:
            arm = reading.arm_of_model(args, model)
            arm.place(args.flange)  # a missing flange is reported before the update
        result, known = update_model(model, recording, known)
        load = None
        with suppress(DataError):  # a load that is not known has no line
            load = load_of(result.model)
        flange = None if arm is None or load is None else in_frame(load, arm, args.flange)
        report('update', 1.0)
    if not args.dry_run:
        save_model(target, result.model)
    warnings = [*filter(None, [known.problem]), *result.report.warnings,
                *reading.scale_warnings(model, recording.reports),
                *(f'the model was already fitted to {name}: does it contain the new payload?'
                  for name in reading.fitted_names(model, recording.reports))]
    document = {
        'model': str(target), 'written': not args.dry_run, **result.report.to_json(),
        'effects': [effect.target for effect in result.model.applied.effects],
        'description': known.to_json(), 'warnings': warnings,
        'flange': flange, **recording.to_json()}
    drive = [] if flange is None else [f'for a drive: {flange.sentence()}']
    return Answer(document, [
        *reading.lines(recording), *known.notes, '', _joint_table(result),
        *_payload_lines(result.report.payload), *drive, '', *_written(args, target)], warnings)


def _written(args: argparse.Namespace, target: Path) -> list[terminal.Line]:
    """Return lines on the written model, and the next step."""
    if args.dry_run:
        return ['nothing written (--dry-run)']
    undo: list[terminal.Line] = ['to undo:', terminal.command(shlex.join(
        ['gravity_comp', 'update', '--undo', '--model', str(target)]))]
    return [f'written to {target}', *(undo if target == args.model else []),
            *next_step.lines('compare with the new payload, preferably on another recording of it',
                             next_step.command('compare', args, model=target))]


def _joint_table(result: UpdateResult) -> TextTable:
    report = result.report
    rows = [(name, f'{report.effect_mean[name]:+.3f}', f'{report.effect_max[name]:.3f}',
             f'± {HALF_95 * report.std[name]:.3f}', f'{report.rmse_before[name]:.4f}',
             f'{report.rmse[name]:.4f}') for name in result.model.joints]
    return TextTable(
        ('joint', 'mean', 'largest', 'uncertainty (95 %)', 'RMSE before', 'RMSE after'), rows,
        f'torque of the payload, N·m ({report.n_samples} samples)')


def _payload_lines(payload: PayloadEstimate | None) -> list[str]:
    if payload is None:
        return ['(with --urdf FILE, mass and centre of mass are estimated as well)']
    low, high = payload.mass.ci95
    lines = [f'mass {payload.mass.value:+.3f} kg (95 %: {low:.3f} to {high:.3f})',
             'the interval excludes an error of the torque scale: effort 5 % too high gives a '
             'mass 5 % too high (check with a known mass on the arm)']
    if payload.centre is None:
        return [*lines, 'the mass is not significant, so no centre of mass is estimated']
    return [*lines, f'centre of mass in the frame of {payload.link}: '
            f'{millimetres(payload.centre)}']
