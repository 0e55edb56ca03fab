"""Next steps after a diagnosis: effects to add, open findings, and motions to resolve them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from gravity_comp_ros.commands import next_step, terminal
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding, Verdict
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.printable import counted

_WHY_OPEN = {
    'ambiguous': 'an alternative explains the data equally well; add at most one of them',
    'weak': 'too small, uncertain or not physical: do not add',
    'untestable': 'not identifiable with this motion: do not add',
    'unexplained': 'no known effect describes it',
}


def show(args: argparse.Namespace, diagnosis: Diagnosis) -> None:
    """Show the next commands, with this call's file names, and the open findings."""
    accepted = wording.targets(diagnosis.findings)
    open_ = [f for f in diagnosis.findings if f.verdict not in wording.FOUND]
    if accepted:
        effects = 'the effect' if len(accepted) == 1 else \
            f'all {len(accepted)} established or likely effects together'
        next_step.show(f'add {effects}', *add_commands(args, accepted))
    elif not diagnosis.findings and args.model is not None:
        next_step.show('nothing to add; plot measured and predicted torque',
                       next_step.command('replay', args, '-o', 'replay.mcap', model=args.model,
                                         bags=args.bags[:1]))
    if open_:
        _show_open(args, open_, fit_shown=bool(accepted))
    terminal.show('')


def add_commands(args: argparse.Namespace, targets: Sequence[str]) -> list[str]:
    """Return the command lines that add effects, preceded by a fit if there is no model."""
    if not targets:
        return []
    model = args.model or next_step.new_model()
    bags = [Path(','.join(targets)), *args.bags]   # effects come before the bags
    add = next_step.command('add', args, bags=bags, model=model)
    return [add] if args.model is not None else [_fit_command(args, model), add]


def _fit_command(args: argparse.Namespace, model: Path | str) -> str:
    return next_step.command('fit', args, '-o', str(model))


def _show_open(args: argparse.Namespace, findings: Sequence[Finding], fit_shown: bool) -> None:
    terminal.show('', f'[bold]open[/bold]: {counted(len(findings), "finding")} not to add yet')
    for finding in findings:
        for line in _open_lines(finding):
            terminal.show(line)
    ambiguous = [f for f in findings if f.verdict == Verdict.AMBIGUOUS and f.effect is not None]
    if ambiguous:
        best = [target(f.effect or '', f.joint) for f in ambiguous]
        next_step.show('or add the best of each group of ambiguous effects (`add --undo` removes '
                       'it)', *add_commands(args, best)[-1 if fit_shown else 0:])
    motions = [f for f in findings if f.next_step and f.effect is not None]
    if motions:
        model = args.model or next_step.new_model()
        fit = [] if args.model is not None else [_fit_command(args, model)]
        next_step.show('plan the motion that resolves them, record it, and diagnose all '
                       'recordings together', *fit,
                       next_step.command('plan', args, '-o', next_step.new_name('motion', 'yaml'),
                                         model=model))


def _open_lines(finding: Finding) -> list[str]:
    """Return lines of markup on an open finding, its alternatives and its motion."""
    name = finding.effect or 'unknown'
    lines = [f'{name} on {wording.where(finding)}: {finding.verdict}, '
             f'{_WHY_OPEN[finding.verdict]}']
    if finding.rivals:
        lines.append(f'  alternative: {", ".join(finding.rivals)}, with similar evidence')
    if finding.next_step:
        lines.append(f'  to resolve it: {finding.next_step}')
    return ['  ' + '  ' * line.startswith('  ') + terminal.safe(line) for line in lines]
