"""
Add effects to a model, refit it, and compare held-out errors.

For example:
  gravity_comp add coulomb_friction:elbow --model arm.json run1.mcap run2.mcap
  gravity_comp add coulomb_friction,viscous_friction --model arm.json run1.mcap
                                       on every joint where they are identifiable
  gravity_comp add torque_offset:wrist --model arm.json run1.mcap --dry-run
  gravity_comp add --undo --model arm.json

Gravity and effects are fitted jointly, to the samples that pass the gate of `fit` unless another
is named, without the data that `fit --holdout` held out. Errors are held-out errors, of whole runs
or of blocks of time. If another effect explains the recordings equally well, `add` lists it.
docs/effects.md describes every effect.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
import shlex
from typing import TYPE_CHECKING

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import add_to_model, with_enough_motion
from gravity_comp_ros.commands import arguments, next_step, reading, terminal
from gravity_comp_ros.commands.terminal import Answer
from gravity_comp_ros.effects.registry import all_effects, requests
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model, save_model

if TYPE_CHECKING:
    from gravity_comp_ros.estimation.refit import Refit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `add`."""
    parser.add_argument('effects', metavar='EFFECT[:JOINT]', nargs='?',
                        help='effects to add, separated by commas; without a joint, on every '
                        'joint where the effect is identifiable')
    arguments.add_bags(parser, nargs='*')
    arguments.add_model(parser, 'model file to change')
    parser.add_argument('--undo', action='store_true',
                        help='remove the last addition; needs no bag')
    parser.add_argument('--dry-run', action='store_true', help='show the result, write nothing')
    arguments.add_gate(parser, 'fitted samples (default: those of the gate of `fit`)')
    arguments.add_reading(parser, joints=False)
    parser.set_defaults(output=None, in_place='model')
    arguments.add_json(parser)


def run(args: argparse.Namespace) -> Answer:
    """Add effects or undo the last addition; write the model."""
    _check_usage(args)
    model = load_model(args.model)
    return reading.undo(args, model, args.model) if args.undo else _add(args, model)


def _check_usage(args: argparse.Namespace) -> None:
    if args.undo and args.effects is not None:
        args.parser.error('--undo removes the last addition; it takes no effect and no bag')
    if not args.undo and not (args.effects and args.bags):
        args.parser.error('name an effect and at least one bag, or give --undo')


def _add(args: argparse.Namespace, model: GravityModel) -> Answer:
    effects = args.effects.split(',')
    requests(effects, model.joints)  # report a misspelt name before bags are read
    args.joints = model.joints
    with terminal.progress() as report:
        recording = replace(reading.load(args, report, is_gated=False),
                            gate=reading.fitted_gate(args, model))
        fitted = with_enough_motion(recording)
        result = add_to_model(model, fitted, effects, report)
    reports = recording.reports
    if not args.dry_run:
        save_model(args.model, result.model)
    warnings = reading.refit_warnings(result)
    document = {
        'model': str(args.model), 'written': not args.dry_run, **result.to_json(),
        'warnings': warnings,
        'ties': [_tie(*tie) for tie in result.ties.items()],
        **fitted.to_json()}
    return Answer(document, _lines(args, result, fitted), [
        *filter(None, [fitted.ungated]), *reading.scale_warnings(model, reports), *warnings])


def _tie(name: str, others: tuple[str, ...]) -> dict[str, object]:
    """Return an effect that others explain as well, as `add --json` prints it."""
    effect, _, joint = name.partition(':')
    experiment = all_effects()[effect].experiment.format(joint=joint or 'the arm')
    return {'effect': effect, 'joint': joint or None, 'rivals': others, 'settled_by': experiment}


def _lines(args: argparse.Namespace, result: Refit, recording: Recording
           ) -> list[terminal.Line]:
    lines = [*reading.lines(recording, thinned=False), *reading.refit_lines(result)]
    lines += [f'{name} is ambiguous: {", ".join(others)} explains these recordings equally well. '
              f'Motion that distinguishes them: {_tie(name, others)["settled_by"]}'
              for name, others in result.ties.items()]
    if args.dry_run:
        return [*lines, '', 'nothing written (--dry-run)']
    undo = shlex.join(['gravity_comp', 'add', '--undo', '--model', str(args.model)])
    following = ('test for further missing effects',
                 next_step.command('diagnose', args, model=args.model)) if result.helps else (
        'undo the addition: it does not reduce the error (see the warning)', undo)
    return [*lines, '', f'written to {args.model}; to undo:', terminal.command(undo),
            *next_step.lines(*following)]
