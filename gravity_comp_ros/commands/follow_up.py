"""What to do after a diagnosis: which findings to add, which to leave open, what settles those."""

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
    'ambiguous': 'others explain as much; one of them may be added today, and a motion settles it',
    'weak': 'too small to be sure: leave it out',
    'untestable': 'this motion cannot show it: leave it out',
    'unexplained': 'no known effect describes it: there is nothing to add',
}


def show(args: argparse.Namespace, diagnosis: Diagnosis) -> None:
    """Show the commands that follow, with this call's file names, and what stays open."""
    sure = wording.targets(diagnosis.findings)
    open_ = [f for f in diagnosis.findings if f.verdict not in wording.FOUND]
    if sure:
        all_of = 'it' if len(sure) == 1 else f'all {len(sure)}, established or likely, at once'
        next_step.show(f'add {all_of}; the rest stays out', *adding(args, sure))
    elif not diagnosis.findings and args.model is not None:
        next_step.show('nothing to add; look at measured and predicted torque side by side',
                       next_step.command('replay', args, '-o', 'replay.mcap', model=args.model,
                                         bags=args.bags[:1]))
    if open_:
        _show_open(args, open_, fit_shown=bool(sure))
    terminal.show('')


def adding(args: argparse.Namespace, targets: Sequence[str]) -> list[str]:
    """Return the command lines that add effects, a fit before them without a model."""
    if not targets:
        return []
    model = args.model or next_step.new_model()
    bags = [Path(','.join(targets)), *args.bags]   # effects come before the bags
    add = next_step.command('add', args, bags=bags, model=model)
    return [add] if args.model is not None else [_fitting(args, model), add]


def _fitting(args: argparse.Namespace, model: Path | str) -> str:
    return next_step.command('fit', args, '-o', str(model))


def _show_open(args: argparse.Namespace, findings: Sequence[Finding], fit_shown: bool) -> None:
    terminal.show('', f'[bold]open[/bold]: {counted(len(findings), "finding")} not to be added '
                  'yet')
    for finding in findings:
        for line in _open_lines(finding):
            terminal.show(line)
    tied = [f for f in findings if f.verdict == Verdict.AMBIGUOUS and f.effect is not None]
    if tied:
        best = [target(f.effect or '', f.joint) for f in tied]
        next_step.show('or let the error fall today, with the best of each tie (`add --undo` '
                       'takes it back)', *adding(args, best)[-1 if fit_shown else 0:])
    motions = [f for f in findings if f.next_step and f.effect is not None]
    if motions:
        model = args.model or next_step.new_model()
        fit = [] if args.model is not None else [_fitting(args, model)]
        next_step.show('plan the motion that settles them, record it, and diagnose it together '
                       'with these', *fit,
                       next_step.command('plan', args, '-o', next_step.new_name('motion', 'yaml'),
                                         model=model))


def _open_lines(finding: Finding) -> list[str]:
    """Return lines of markup on a finding that is not sure, on its alternatives and its motion."""
    name = finding.effect or 'unknown'
    lines = [f'{name} on {wording.where(finding)}: {finding.verdict}, '
             f'{_WHY_OPEN[finding.verdict]}']
    if finding.rivals:
        lines.append(f'  or rather {", ".join(finding.rivals)}, a little worse on held-out data')
    if finding.next_step:
        lines.append(f'  what settles it: {finding.next_step}')
    return ['  ' + '  ' * line.startswith('  ') + terminal.safe(line) for line in lines]
