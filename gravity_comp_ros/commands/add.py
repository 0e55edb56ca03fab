"""`gravity_comp add`: add effects to a model with a joint refit, or undo the last addition."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, replace
import shlex

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import add_to_model, not_held_out
from gravity_comp_ros.commands import next_step, reading, refitting, terminal
from gravity_comp_ros.commands.refitting import HeldOutError
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Finding, Verdict
from gravity_comp_ros.diagnosis.options import DiagnosisOptions
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.estimation.refit import Refit
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.recordings.bag import ReadReport

_NOT_DISTINGUISHED = (Verdict.AMBIGUOUS, Verdict.UNTESTABLE)


def run(args: argparse.Namespace) -> int:
    """Add effects or undo the last addition; write the model."""
    _check_usage(args)
    model = load_model(args.model)
    return _undo(args, model) if args.undo else _add(args, model)


def _check_usage(args: argparse.Namespace) -> None:
    if args.undo and args.effects is not None:
        args.parser.error('--undo removes the last addition; it takes no effect and no bag')
    if not args.undo and not (args.effects and args.bags):
        args.parser.error('name an effect and at least one bag, or give --undo')


def _undo(args: argparse.Namespace, model: GravityModel) -> int:
    back = refitting.undo(args, model, args.model)
    step = back.history[-1]
    remaining = [effect.target for effect in back.applied.effects]
    removed = 'would be removed from' if args.dry_run else 'removed from'
    terminal.answer(args, {'model': str(args.model), 'removed': list(step.effects),
                           'effects': remaining, 'written': not args.dry_run},
                    lambda: terminal.say(f'{", ".join(step.effects)} {removed} {args.model}; '
                                         f'remaining effects: {", ".join(remaining) or "none"}'))
    return 0


def _add(args: argparse.Namespace, model: GravityModel) -> int:
    effects = args.effects.split(',')
    requests(effects, model.joints)  # report a misspelt name before bags are read
    refitting.check_holdout(args, model)
    args.joints = model.joints
    with terminal.progress() as report:
        recording = reading.load(args, report, is_gated=False)
        result = add_to_model(model, recording, effects, refitting.speeds(args), report)
        ambiguous = _ambiguous(model, recording, result.added)
    reports = recording.reports
    holdout = refitting.held_out_errors(
        model, result.model, replace(recording, gate=GateOptions())) if args.holdout else {}
    if not args.dry_run:
        save_model(args.model, result.model)
    warnings = refitting.warnings(result)
    document = {
        'model': str(args.model), 'written': not args.dry_run, **result.to_json(),
        'warnings': warnings,
        'ties': [{'effect': finding.effect, 'joint': finding.joint, 'rivals': finding.rivals,
                  'settled_by': finding.next_step} for finding in ambiguous],
        'on_holdout': {name: asdict(error) for name, error in holdout.items()}
        if args.holdout else None,
        'bags': [r.to_json() for r in reports]}
    terminal.answer(args, document, lambda: _show(args, result, reports, ambiguous, holdout),
                    *reading.scale_warnings(model, reports), *warnings)
    return 0


def _ambiguous(model: GravityModel, recording: Recording,
               added: Sequence[str]) -> tuple[Finding, ...]:
    """
    Return the findings on added effects that have an equivalent alternative.

    The added effects are compared with their confounders only, jointly with the earlier effects
    of the model. The result is empty if there are too few samples.

    :param model: the model without the added effects.
    :param added: the added effects, on every joint (`NAME`) or on one
        (`NAME:JOINT`).
    :raises ModelMismatchError: if a joint of the model is missing in the recording.
    """
    known = all_effects()
    names = {name.partition(':')[0] for name in added} & known.keys()
    # An effect of the whole arm can replace effects on several joints at once. That is no
    # alternative to a single one of them.
    alternatives = {other for name in names for other in known[name].confounders
                    if other in known and known[other].scope == known[name].scope}
    if not alternatives:
        return ()
    recording = recording.select_joints(model.joints)
    samples = recording.samples.select(not_held_out(model, recording))
    options = DiagnosisOptions(effects=tuple(sorted(names | alternatives)))
    try:
        diagnosis = diagnose(samples, model, options)
    except DataError:
        return ()
    targets = {*added, *(f'{name}:{joint}' for name in names if name in added
                         for joint in model.joints)}
    return tuple(f for f in diagnosis.findings if f.verdict in _NOT_DISTINGUISHED and f.rivals
                 and f.effect and target(f.effect, f.joint) in targets)


def _show(args: argparse.Namespace, result: Refit, reports: tuple[ReadReport, ...],
          ambiguous: Sequence[Finding], holdout: dict[str, HeldOutError]) -> None:
    terminal.say(*reading.bag_lines(reports))
    terminal.show(refitting.fitted_sentence(result), '', refitting.error_table(result),
                  *refitting.effect_lines(result))
    if holdout:
        terminal.show('', refitting.held_out_table(holdout))
    for finding in ambiguous:
        name, alternatives = target(finding.effect or '', finding.joint), ', '.join(finding.rivals)
        terminal.say(
            f'{name} is ambiguous: {alternatives} explains these recordings equally well. Keep '
            f'only one of them. Motion that distinguishes them: {finding.next_step}')
    if args.dry_run:
        terminal.show('', 'nothing written (--dry-run)')
        return
    undo = shlex.join(['gravity_comp', 'add', '--undo', '--model', str(args.model)])
    terminal.show('', terminal.safe(f'written to {args.model}; to undo:'))
    terminal.show_command(undo)
    if not result.helps:
        next_step.show('undo the addition: it does not reduce the error (see the warning)', undo)
        return
    next_step.show('test for further missing effects',
                   next_step.command('diagnose', args, model=args.model))
