"""`gravity_comp add`: put effects into a model, see the held-out error fall, or take them back."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, replace
import shlex

from gravity_comp_ros.api.ambiguity import ambiguous_additions
from gravity_comp_ros.api.steps import add_to_model
from gravity_comp_ros.commands import held_out, next_step, reading, refitting, terminal
from gravity_comp_ros.commands.held_out import HeldOutError
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.estimation.refit_result import Refit
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.recordings.bag import ReadReport


def run(args: argparse.Namespace) -> int:
    """Change the model, show what it brought, and write it."""
    _check_usage(args)
    model = load_model(args.model)
    return _undo(args, model) if args.undo else _add(args, model)


def _check_usage(args: argparse.Namespace) -> None:
    if args.undo and args.effects is not None:
        args.parser.error('--undo takes back the last addition; it needs no effect and no bag')
    if not args.undo and not (args.effects and args.bags):
        args.parser.error('name an effect and at least one bag, or give --undo')


def _undo(args: argparse.Namespace, model: GravityModel) -> int:
    back = refitting.undo(args, model, args.model)
    step = back.history[-1]
    left = [effect.target for effect in back.applied.effects]
    if args.json != '-':
        done = 'would be taken back from' if args.dry_run else 'taken back from'
        terminal.say(f'{", ".join(step.effects)} {done} {args.model}; the model '
                     f'is as it was before, with {", ".join(left) or "no effect"}')
    if args.json:
        terminal.emit_json({'model': str(args.model), 'removed': list(step.effects),
                            'effects': left, 'written': not args.dry_run}, args.json)
    return 0


def _add(args: argparse.Namespace, model: GravityModel) -> int:
    effects = args.effects.split(',')
    requests(effects, model.joints)  # a slip of the keyboard shows before bags are read
    held_out.required(args, model)
    args.joints = model.joints
    with terminal.progress() as report:
        recording = reading.load(args, report, is_gated=False)
        result = add_to_model(model, recording, effects, refitting.speeds(args), report)
        ties = ambiguous_additions(model, recording, result.added)
    reports = recording.reports
    aside = held_out.errors(model, result.model, replace(recording, gate=GateOptions())) \
        if args.holdout else {}
    if not args.dry_run:
        save_model(args.model, result.model)
    if args.json != '-':
        _show(args, result, reports, ties, aside)
    terminal.warn(*reading.scale_warnings(model, reports), *refitting.warnings(result))
    if args.json:
        terminal.emit_json(
            {'model': str(args.model), 'written': not args.dry_run,
             **result.to_json(), 'warnings': refitting.warnings(result),
             'ties': [{'effect': tie.effect, 'joint': tie.joint, 'rivals': tie.rivals,
                       'settled_by': tie.next_step} for tie in ties],
             'on_holdout': {name: asdict(error) for name, error in aside.items()}
             if args.holdout else None,
             'bags': [r.to_json() for r in reports]}, args.json)
    return 0


def _show(args: argparse.Namespace, result: Refit, reports: tuple[ReadReport, ...],
          ties: Sequence[Finding], aside: dict[str, HeldOutError]) -> None:
    terminal.say(*reading.bag_lines(reports))
    terminal.show(refitting.fitted_sentence(result), '', refitting.error_table(result),
                  *refitting.effect_lines(result))
    if aside:
        terminal.show('', held_out.table(aside))
    for tie in ties:
        terminal.say(
            f'{target(tie.effect or "", tie.joint)} is one of a tie: {", ".join(tie.rivals)} '
            f'would explain these recordings as well. The error falls with any of them; keep '
            f'one. What settles it: {tie.next_step}')
    if args.dry_run:
        terminal.show('', 'nothing written (--dry-run)')
        return
    undo = shlex.join(['gravity_comp', 'add', '--undo', '--model', str(args.model)])
    terminal.show('', terminal.safe(f'written to {args.model}; this takes it back:'))
    terminal.show_command(undo)
    if not result.helps:
        next_step.show('take it back: it does not pay (see the warning)', undo)
        return
    next_step.show('is more missing?', next_step.command('diagnose', args, model=args.model))
