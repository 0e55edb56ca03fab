"""
Learn the gravity model of an arm from slow motion.

For example:
  gravity_comp fit run1.mcap run2.mcap -o arm.json
  gravity_comp fit run1.mcap --holdout -o arm.json      report the held-out error
  gravity_comp fit run1.db3 --joints a1,a2,a3 --effort-scale a1=-1,a2=-1,a3=-1 -o arm.json
  gravity_comp fit run1.mcap --effects coulomb_friction,torque_offset:wrist -o arm.json
  gravity_comp fit run1.mcap --formulation per_joint --json report.json -o paper.json
  gravity_comp fit run1.mcap --urdf robot.urdf -o arm.json   chain with known axes

which recordings: slow motion (every joint under 0.15 rad/s) through the poses of the task, every
joint in both directions, with a constant payload; a minute or more, two runs rather than one.

Gravity is fitted jointly with friction, inertia and other effects, to slow samples, or to all if
fewer than 100 of at least 200, or less than a fifth, are slow. With --holdout the saved model is
fitted without the held-out data; `compare --holdout` uses that data.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from math import degrees
import time
from typing import TYPE_CHECKING

from gravity_comp_ros.api.axes import known_arm
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import compare_model, learn, Learned, with_enough_motion
from gravity_comp_ros.commands import arguments, next_step, reading, terminal
from gravity_comp_ros.commands.terminal import Answer
from gravity_comp_ros.display import shortened, TextTable
from gravity_comp_ros.evaluation.compare import Comparison
from gravity_comp_ros.models.gravity_model import CHOICES
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.printable import counted

if TYPE_CHECKING:
    from gravity_comp_ros.estimation.fit import FitResult

# Number of terms shown of each equation.
_SHOWN = 8


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fit`."""
    parser.add_argument('-o', '--output', metavar='MODEL.json',
                        type=arguments.file_type('.json'),
                        help='model file to write (without it, the fit is only shown)')
    parser.add_argument('--formulation', choices=CHOICES,
                        help='potential: one potential energy for all joints; chain: potential '
                        'energy of a serial arm; auto: the chain if its residual is white or '
                        'small, else the one of these two with the smaller held-out error; '
                        'per_joint: each joint separately, as in Yu 2022 '
                        '(default: auto; chain with --urdf)')
    parser.add_argument('--holdout', metavar='SHARE', type=arguments.positive, nargs='?',
                        const=0.2, help='share of the data held out of the fit '
                        'for the error: whole runs, or blocks of a single run (0.2 if no number '
                        'is given)')
    parser.add_argument('--effects', metavar='A,B:JOINT,...',
                        help='effects fitted jointly with gravity; without a joint, on every '
                        'joint where they are identifiable (docs/effects.md lists all)')
    arguments.add_urdf(parser, 'joint axes of the chain', or_none=True)
    arguments.add_bags(parser)
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)


def run(args: argparse.Namespace) -> Answer:
    """Fit, compare with held-out data, save and show."""
    options = arguments.arm_options(args, args.formulation)
    with terminal.progress() as report:
        whole = with_enough_motion(reading.load(args, report))
        arm = known_arm(whole, options)
        whole = arm.of(whole)
        fitted, held = whole.split(args.holdout) if args.holdout else (whole, None)
        effects = args.effects.split(',') if args.effects is not None else ()
        started = time.perf_counter()
        learned = learn(fitted, options, effects, report, arm)
        seconds = time.perf_counter() - started
    result, model, refit = learned.result, learned.model, learned.refit
    held_out = compare_model(model, held) if held else None
    if args.output:
        save_model(args.output, model)
    warnings = reading.refit_warnings(refit) if refit else []
    document = {
        'model': str(args.output) if args.output else None, **result.to_json(),
        'seconds': seconds, 'holdout': model.provenance['holdout'],
        'facts': [each.to_json() for each in learned.facts],
        'description': learned.arm.to_json(),
        'joint_order': learned.arm.order.source, **whole.to_json()}
    if refit:
        document |= {**refit.to_json(), 'warnings': warnings}
    for name, error in held_out.joints.items() if held_out else ():
        document['joints'][name]['held_out'] = error
    # In the document they are part of the report.
    return Answer(document, _lines(args, learned, held_out, seconds),
                  [*(result.report.warnings if args.json != '-' else ()),
                   *(each.sentence for each in learned.facts), *warnings])


def _lines(args: argparse.Namespace, learned: Learned, held_out: Comparison | None,
           seconds: float) -> list[terminal.Line]:
    from gravity_comp_ros.estimation.fit_report import fitted_sentence
    fitted, arm, result = learned.recording, learned.arm, learned.result
    effects, report = fitted_sentence(result.model), result.report
    saved = f'saved in {args.output}' if args.output else 'not saved (no -o)'
    return [
        *reading.lines(fitted, thinned=False), *arm.notes, f'joint order: {arm.order.source}',
        '', _joint_table(result), _solver_sentence(result), *_holdout_lines(fitted, held_out),
        *([f'{effects} (`gravity_comp diagnose` identifies them)'] if effects else []),
        'RMSE is the error of the prediction; the remaining error is that with all fitted terms',
        f'{report.formulation} was chosen: {report.why}', '',
        terminal.styled('bold', 'torque in N·m', ' (s2, c2: sine and cosine of the angle of the '
                        'second joint)'),
        *(terminal.styled('bold', f'  {joint}',
                          f' = {shortened(result.model.equation(joint), _SHOWN)}')
          for joint in result.model.joints),
        '', f'fitted in {seconds:.2f} s; {saved}', *_next_step(args),
        *(['', *reading.refit_lines(learned.refit)] if learned.refit else [])]


def _next_step(args: argparse.Namespace) -> list[terminal.Line]:
    if args.output is None:
        return next_step.lines('repeat the fit and save the model',
                               f'{args.command} -o {next_step.new_name()}')
    diagnose = next_step.command('diagnose', args, model=args.output)
    if args.holdout:
        return next_step.lines(
            'compare with the held-out data, then identify missing effects',
            next_step.command('compare', args, '--holdout', model=args.output), diagnose)
    return next_step.lines('identify missing effects, with the fitted recordings and any others '
                           'of this arm (`compare` requires other recordings)', diagnose)


def _holdout_lines(fitted: Recording, held_out: Comparison | None) -> list[terminal.Line]:
    """Return the blocks that are held out, and the error on them."""
    if fitted.holdout is None or held_out is None:
        return []
    blocks = ', '.join(f'{block.start:.1f} to {block.end:.1f} s of '
                       f'{fitted.reports[block.run].path.name}' for block in fitted.holdout.blocks)
    errors = held_out.table()
    return ['', replace(errors, title=f'error on held-out data, {blocks}')]


def _joint_table(result: FitResult) -> TextTable:
    model, report = result.model, result.report
    rows = [(joint, str(model.n_features()[n]),
             f'{model.coverage.q_min[n]:.2f} … {model.coverage.q_max[n]:.2f}',
             f'{report.rmse[joint]:.4f}', f'{report.noise[joint]:.4f}')
            for n, joint in enumerate(model.joints)]
    return TextTable(
        ('joint', 'terms', 'range rad', 'RMSE N·m', 'remaining N·m'), rows,
        f'gravity model, {model.formulation}: {model.coverage.n_samples} samples of '
        f'{counted(model.coverage.n_runs, "run")}')


def _solver_sentence(result: FitResult) -> str:
    report = result.report
    if result.model.chain is not None:
        residual = f'the residual is {"" if report.white else "not "}white'
        if report.known_axes:
            tilt = degrees(report.base_tilt)
            base = f', base tilted by {tilt:.1f} degrees' if tilt else ''
            return f'chain: axes from the URDF{base}; {residual}'
        return f'chain: axes from the torque; {residual}'
    problems = [solution.lasso for solution in result.report.solver]
    ends = [problem.certificate for problem in problems]
    iterations = sum(problem.iterations for problem in problems)
    return (f'ADMM: {counted(len(problems), "L1 problem")}, {iterations} iterations, worst primal '
            f'residual {max(end.primal_residual for end in ends):.1e}, dual '
            f'{max(end.dual_residual for end in ends):.1e}, relative gap '
            f'{max(end.gap for end in ends):.1e}{"" if result.converged else ": NOT CONVERGED"}')
