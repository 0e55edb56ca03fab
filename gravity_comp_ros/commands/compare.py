"""
Compare the torque of a model with measured torque, for each joint.

For example:
  gravity_comp compare run2.mcap --model arm.json
  gravity_comp compare run1.mcap --model arm.json --holdout      only the held-out part of run1
  gravity_comp compare fast.mcap --model arm.json --all-samples --json errors.json
  gravity_comp compare run2.mcap --model arm.json --html report.html      report with plots

which recordings: recordings that were not fitted, with the payload of the model. Errors on fitted
recordings are too small. For a held-out error use `fit --holdout`, then --holdout here.

RMSE, std and max are of the residual, measured minus predicted torque. nRMSE is RMSE over the
range of the measured torque (Yu 2022, Eq. 16). "in band" and "outside" are the shares of residuals
inside the 95 % prediction band, within the trained range and outside of it: a share far below 95 %
indicates a changed payload or a missing effect. "training" is the RMSE of the fit, "constant" that
of a constant torque.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import compare_model, held_out_blocks
from gravity_comp_ros.commands import arguments, html, next_step, reading, terminal
from gravity_comp_ros.data.runs import Block, within
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.display import percent, TextTable
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.evaluation.compare import COMPARISON, Comparison
from gravity_comp_ros.evaluation.drift import Drift, drift
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.topic_choice import named_joints

_MAX_REGIONS = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `compare`."""
    arguments.add_model(parser, 'model file, written by `fit`')
    parser.add_argument('--holdout', action='store_true',
                        help='of the fitted bags, use only the data that `fit --holdout` '
                        'held out')
    arguments.add_urdf(parser, arguments.DRAWN, fixed=False)
    parser.add_argument('--previous', metavar='MODEL.json', type=Path,
                        help='earlier model of this arm: what drifted since then; the --html '
                        'report also lists its errors (default there: before the last addition)')
    arguments.add_bags(parser)
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)
    arguments.add_page(parser)


def run(args: argparse.Namespace) -> terminal.Answer:
    """Read, predict, compare and show."""
    html.check_libraries(args)
    model = load_model(args.model)
    previous = None if args.previous is None else load_model(args.previous)
    selected = named_joints('--joints: the model', model.joints, args.joints or model.joints,
                            'shown')
    # The model requires all of its joints; --joints only selects those to show.
    args.joints = model.joints
    with terminal.progress() as report:
        recording, fitted = _unseen(args, model, reading.load(args, report))
    samples = recording.slow
    comparison = compare_model(model, recording)
    since = None if previous is None else drift(previous, model, samples)
    listed = replace(comparison, joints={name: comparison.joints[name] for name in selected})
    diagnose = next_step.command('diagnose', args, model=args.model)
    if args.html:
        before, name = _previous(args, model, previous, recording)
        html.write_report(
            args, model, recording.samples, comparison, _samples_text(samples, recording),
            recording.reports, previous=before, previous_name=name, displayed=selected,
            next_command=diagnose)
    document = {**listed.to_json(), 'model': args.model.name, 'fitted_to': fitted,
                'previous': None if since is None else {
                    'model': args.previous.name, **vars(since)}, **recording.to_json()}
    few = not args.all_samples and samples.n_samples < FactOptions().min_slow_samples
    errors = listed.table(noise=dict(zip(model.joints, model.noise.tolist())))
    title = f'error of the model, {counted(samples.n_samples, "sample")}'
    return terminal.Answer(
        document, [*reading.lines(recording), '',
                   replace(errors, title=title), *_failures(listed),
                   *([] if since is None else [
                       *_drift_lines(args.previous.name, selected, since),
                       *_updates_since(previous, model)]),
                   *next_step.lines('identify missing effects', diagnose)],
        [*reading.scale_warnings(model, recording.reports),
         *[f'only {counted(samples.n_samples, "slow sample")}: the error is unreliable; the '
           'torque of fast samples includes friction and inertia (--all-samples)'] * few,
         *(f'the model was fitted to {name}: its error there is too small (fit and compare with '
           '--holdout, or compare on another run)' for name in fitted)])


def _samples_text(samples: JointSamples, recording: Recording) -> str:
    """Return a description of the compared samples."""
    selected = recording.gated.samples.n_samples
    held = '' if samples.n_samples == selected else f'; {samples.n_samples} of them were held out'
    return f'{counted(samples.n_samples, "sample")} ({recording.gated.sentence()}{held})'


def _previous(args: argparse.Namespace, model: GravityModel, previous: GravityModel | None,
              recording: Recording) -> tuple[dict[str, float], str]:
    """Return RMSE by joint of an earlier model on the same samples, and its name."""
    if previous is not None:
        other, name = previous, args.previous.name
    else:
        steps = [step for step in model.history if step.previous is not None]
        if not steps or steps[-1].previous is None:
            return {}, ''
        other, name = steps[-1].previous, f'before {", ".join(steps[-1].effects)}'
    errors = compare_model(other, recording)
    return {joint: x.rmse for joint, x in errors.joints.items()}, name


def _unseen(args: argparse.Namespace, model: GravityModel,
            recording: Recording) -> tuple[Recording, list[str]]:
    """Return the samples to compare, and the names of fitted bags among them."""
    fitted = reading.fitted_names(model, recording.reports)
    if not args.holdout:
        return recording, fitted
    if not (model.provenance.get('holdout') or {}).get('blocks'):
        raise OptionError(f'{args.model} was fitted without --holdout: fit it with --holdout')
    recording = replace(recording, gate=reading.fitted_gate(args, model))
    unfitted = [Block(run, -float('inf'), float('inf'))
                for run, report in enumerate(recording.reports) if report.path.name not in fitted]
    blocks = held_out_blocks(model, recording.reports)
    selected = replace(recording, use=within(recording.samples, [*unfitted, *blocks]))
    if not selected.slow.n_samples:
        raise DataError('the model was fitted to all of these bags: none of their data was held '
                        'out')
    return selected, []


def _failures(comparison: Comparison) -> list[str]:
    """Return lines on the worst joint, regions of large error, and the 95 % band."""
    worst, outside = comparison.worst, comparison.share_outside
    lines = [f'worst joint: {worst}, RMSE {comparison.joints[worst].rmse:.4g} N·m']
    if outside > 0.0:
        lines.append(f'{100 * outside:.1f} % of the samples are outside the trained poses')
    lines += [f'  {name} {region.words}' for name, errors in comparison.joints.items()
              for region in errors.where[:_MAX_REGIONS]]
    shares = [f'{percent(share)} of the residuals {where} the trained range' for where, share in (
        ('in', comparison.in_band), ('outside', comparison.in_band_outside)) if share is not None]
    return [*lines, *([f'inside the 95 % prediction band: {" and ".join(shares)}']
                      if shares else [])]


def _drift_lines(name: str, selected: Sequence[str], since: Drift) -> list[terminal.Line]:
    """Return the change of each joint, and of each coefficient that changed."""
    rows = [(joint, f'{one.rms:.4f}', f'{one.mean:+.4f}',
             '' if one.std is None else f'{one.std:.4f}',
             'unknown' if one.unknown else 'yes' if one.drifted else 'no')
            for joint, one in since.joints.items() if joint in selected]
    lines = [f'{one.target} {one.symbol}: '
             + ' → '.join('not found' if x is None else wording.plus_minus(x)
                          for x in (one.before, one.after))
             for one in since.coefficients
             if one.drifted and one.target.split(':', 1)[1] in selected]
    uncertain = [joint for joint, one in since.joints.items()
                 if joint in selected and one.unknown and one.std is not None]
    if uncertain:
        lines.append(f'the gravity torque of {", ".join(uncertain)} is too uncertain to '
                     f'exclude a change: fit both models to more poses, further apart')
    return ['', TextTable(('joint', 'RMS', 'mean', 'std of both models', 'drifted'), rows,
                          f'change of the gravity torque since {name}, N·m'),
            *(lines or ['no coefficient of an effect drifted'])]


def _updates_since(earlier: GravityModel | None, model: GravityModel) -> list[str]:
    """Return a line on each update of a model since an earlier state of it."""
    if earlier is None or earlier.provenance.get('report') != model.provenance.get('report'):
        return []
    known, updates = (each.provenance.get('updates', []) for each in (earlier, model))
    return [f'update of {each["when"]}: the torque of the payload is up to ' + (', '.join(
        f'{size:.3g} N·m of {joint}' for joint, size in each['effect_max'].items()
        if size > COMPARISON.significance * each['std'][joint]) or 'its uncertainty')
        for each in updates[len(known):]]
