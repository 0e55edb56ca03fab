"""`gravity_comp compare`: how wrong a model is, joint by joint, and where."""

from __future__ import annotations

import argparse
from dataclasses import replace

from gravity_comp_ros.api.provenance import held_out_blocks
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import compare_model
from gravity_comp_ros.commands import held_out, html, next_step, reading, terminal
from gravity_comp_ros.commands.screen_table import ScreenTable
from gravity_comp_ros.data.holdout import Block, within
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.display import percent
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.evaluation.compare import Calibration, JointComparison
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.printable import counted, printable
from gravity_comp_ros.recordings.topic_choice import named_joints
from rich.text import Text

_MOST_PLACES = 2
# Fewer samples than this judge nothing.
_FEW = 50
# Shares of errors inside a 95 % band that are no reason for doubt.
_FAIR = (0.85, 0.99)


@html.told
def run(args: argparse.Namespace) -> int:
    """Read, predict, compare and show."""
    if args.previous is not None and args.html is None:
        args.parser.error('--previous is for the report: give --html as well')
    model = load_model(args.model)
    chosen = named_joints('--joints: the model', model.joints, args.joints or model.joints,
                          'shown')
    # The model needs every one of its joints; --joints only says which of them to show.
    args.joints = model.joints
    with terminal.progress() as report:
        loaded = reading.load(args, report)
    loaded = _gated_as_fitted(args, model, loaded)
    part, fitted = _unseen(args, model, loaded)
    samples = part.slow
    few = _few(args, samples)
    comparison = compare_model(model, part)
    joints = {name: comparison.joints[name] for name in chosen}
    if args.html:
        html.write(args, html.contents(
            args, model, loaded.samples, comparison, _judged(samples, loaded), loaded.reports,
            None, *_previous(args, model, part), shown=chosen,
            next_command=_diagnosing(args)))
    if args.json != '-':
        terminal.say(*reading.lines(loaded))
        terminal.show('', _table(model, joints, samples))
        for line in _failures(joints, comparison.share_outside):
            terminal.show(line)
        terminal.say(*_band(comparison.band))
        if few:
            next_step.show('judge it by fast samples as well', f'{args.command} --all-samples')
        next_step.show('name what the model lacks', _diagnosing(args))
    terminal.warn(*reading.scale_warnings(model, loaded.reports), *few)
    for name in fitted:
        terminal.warn(f'the model was fitted to {name}: its errors there are too small (fit and '
                      'compare with --holdout, or compare with another run)')
    if args.json:
        document = comparison.to_json()
        terminal.emit_json(
            {**document, 'joints': {name: document['joints'][name] for name in chosen},
             'model': args.model.name, 'fitted_to': fitted, **loaded.to_json()}, args.json)
    return 0


def _few(args: argparse.Namespace, samples: JointSamples) -> list[str]:
    if args.all_samples or samples.n_samples >= _FEW:
        return []
    return [f'{counted(samples.n_samples, "slow sample")} judge little; the torque of fast ones '
            f'holds friction and inertia as well (--all-samples)']


def _judged(samples: JointSamples, loaded: Recording) -> str:
    """Return in words which samples the errors are of."""
    kept = loaded.gated.samples.n_samples
    held = '' if samples.n_samples == kept else f'; {samples.n_samples} of them were held out'
    return f'{counted(samples.n_samples, "sample")} ({loaded.gated.sentence()}{held})'


def _diagnosing(args: argparse.Namespace) -> str:
    """Return the command line that names what the model lacks."""
    return next_step.command('diagnose', args, model=args.model)


def _previous(args: argparse.Namespace, model: GravityModel,
              part: Recording) -> tuple[dict[str, float], str]:
    """Return RMSE by joint of an earlier model on the same samples, and its name."""
    if args.previous is not None:
        other, name = load_model(args.previous), args.previous.name
    else:
        steps = [step for step in model.history if step.previous is not None]
        if not steps or steps[-1].previous is None:
            return {}, ''
        other, name = steps[-1].previous, f'before {", ".join(steps[-1].effects)}'
    found = compare_model(other, part)
    return {joint: x.rmse for joint, x in found.joints.items()}, name


def _gated_as_fitted(args: argparse.Namespace, model: GravityModel,
                     loaded: Recording) -> Recording:
    """Return the recording ungated if all samples were fitted, as what was held out of them."""
    if not args.holdout or args.max_speed is not None:
        return loaded
    return replace(loaded, gate=None) if held_out.of_all_samples(model) else loaded


def _unseen(args: argparse.Namespace, model: GravityModel,
            loaded: Recording) -> tuple[Recording, list[str]]:
    """Return the part to judge on, and the bags in it that the model was fitted to."""
    known = reading.fitted_names(model, loaded.reports)
    seen = [run for run, report in enumerate(loaded.reports) if report.path.name in known]
    if not args.holdout:
        return loaded, [loaded.reports[run].path.name for run in seen]
    held_out.required(args, model)
    fresh = [Block(run, -float('inf'), float('inf')) for run in range(len(loaded.reports))
             if run not in seen]
    blocks = held_out_blocks(model, loaded.reports)
    kept = replace(loaded, use=within(loaded.samples, [*fresh, *blocks]))
    if not kept.slow.n_samples:
        raise DataError('the model was fitted to all of these bags: nothing of them was held out')
    return kept, []


def _table(model: GravityModel, joints: dict[str, JointComparison],
           samples: JointSamples) -> ScreenTable:
    worst = _worst(joints)
    rows = []
    for name, found in joints.items():
        cells = [printable(name), str(found.n), f'{found.rmse:.4f}', percent(found.nrmse),
                 f'{found.std:.4f}', f'{found.max_abs:.3f}',
                 f'{model.noise[model.joints.index(name)]:.4f}', *_shares(found.band)]
        rows.append([Text(cell, style='bold' if name == worst else '') for cell in cells])
    return terminal.table(
        f'error of the model in N·m, {counted(samples.n_samples, "sample")}',
        ['joint', 'n', 'RMSE', 'nRMSE', 'std', 'max', 'RMSE in training',
         *(() if model.uncertainty is None else ('in band', 'outside'))], rows)


def _failures(joints: dict[str, JointComparison], outside: float) -> list[str]:
    """Return lines of markup on the worst joint and on where each joint fails."""
    worst = _worst(joints)
    lines = [terminal.safe(f'worst joint: {worst}, RMSE {joints[worst].rmse:.4g} N·m')]
    if outside > 0.0:
        lines.append(f'{100 * outside:.1f} % of the samples lie outside the poses of the training')
    for name, found in joints.items():
        lines += [f'  {terminal.safe(f"{name} {place.words}")}'
                  for place in found.where[:_MOST_PLACES]]
    return lines


def _shares(band: Calibration | None) -> list[str]:
    """Return the shares inside the 95 % band in and outside the trained range, as cells."""
    return [] if band is None else [percent(band.trained.share), percent(band.outside.share)]


def _band(band: Calibration | None) -> list[str]:
    if band is None:
        return []
    parts = [f'{100 * share.share:.1f} % {where}'
             for share, where in ((band.trained, 'in the trained range'),
                                  (band.outside, 'outside of it')) if share.share is not None]
    return [f'"in band", "outside": of the errors, {" and ".join(parts)} lie in the 95 % band '
            f'that the model gives; {_meaning([s.share for s in (band.trained, band.outside)])}']


def _meaning(shares: list[float | None]) -> str:
    """Return in words what shares of errors inside a 95 % band mean."""
    least, most = (end((s for s in shares if s is not None), default=0.95) for end in (min, max))
    if least < _FAIR[0]:
        return ('far below 95 %: the model errs by more than it says, so an effect or a payload '
                'is missing')
    return 'near 95 %, as it should be' if most <= _FAIR[1] else \
        'above 95 %: the model errs by less than it says'


def _worst(joints: dict[str, JointComparison]) -> str:
    return max(joints, key=lambda name: joints[name].rmse)
