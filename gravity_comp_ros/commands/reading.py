"""Recordings named on the command line, and lines that say what was read."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import suppress

from gravity_comp_ros.api.read import read_recording, read_slow
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import MIN_SLOW_SAMPLES, with_enough_motion
from gravity_comp_ros.commands.arguments import gate, read_options
from gravity_comp_ros.commands.terminal import ProgressCallback
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.estimation.regression import excites_inertia
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.bag import ReadReport


def load(args: argparse.Namespace, report: ProgressCallback,
         is_gated: bool = True) -> Recording:
    """
    Return what `args.bags` hold, gated as the arguments ask.

    :param is_gated: False for verbs that choose among all samples themselves.
    :raises BagError: if a bag cannot be read.
    :raises ModelMismatchError: if two bags are of different robots.
    """
    return read_recording(args.bags, read_options(args), gate(args) if is_gated else None, report)


def load_enough(args: argparse.Namespace, report: ProgressCallback,
                only_slow: bool) -> Recording:
    """
    Return a recording to fit, ungated if too little of it is slow.

    :param only_slow: whether nothing but the slow samples is needed if they suffice.
    :raises BagError: if a bag cannot be read.
    :raises ModelMismatchError: if two bags are of different robots.
    """
    if only_slow:
        with suppress(DataError):
            slow = read_slow(args.bags, read_options(args), gate(args), report)
            # Slow samples that start and stop quickly need what lies between them.
            if slow.samples.n_samples >= MIN_SLOW_SAMPLES and not excites_inertia(slow.samples):
                return slow
    return with_enough_motion(load(args, report))


def lines(recording: Recording) -> list[str]:
    """Return plain lines on what was read and gated; they may hold text from the bags."""
    return [*bag_lines(recording.reports), recording.gated.sentence()]


def bag_lines(reports: Sequence[ReadReport]) -> list[str]:
    """Return plain lines on what was read; they may hold text from the bags."""
    found = []
    for report in reports:
        found.append(
            f'{report.path.name}: {report.topic}, {counted(report.n_samples, "sample")} at '
            f'{report.rate_hz:.3g} Hz over {report.duration_s:.1f} s, '
            f'velocity {report.velocity}')
        found += [f'  dropped {count} of {counted(report.n_messages, "message")}: {reason}'
                  for reason, count in report.dropped.items() if count]
        found += [f'  {note}' for note in report.notes]
    return found


def fitted_names(model: GravityModel | None, reports: Sequence[ReadReport]) -> list[str]:
    """Return the names of the recordings here that the model was fitted to."""
    known = {bag['sha256'] for bag in model.provenance.get('bags', ())} if model else set()
    return [report.path.name for report in reports if report.sha256 in known]


def fitted_lines(model: GravityModel | None, reports: Sequence[ReadReport]) -> list[str]:
    """Return a plain line on which recordings the model was fitted to."""
    if model is None:
        return ['no --model: judged beside a gravity model that is fitted on the spot']
    old = fitted_names(model, reports)
    new = [report.path.name for report in reports if report.path.name not in old]
    parts = [f'was fitted to {", ".join(old)}'] if old else []
    parts += [f'has not seen {", ".join(new)}'] if new else []
    return [f'the model {" and ".join(parts)}; errors are of blocks left out in turn, so both '
            'kinds of recording serve']


def scale_warnings(model: GravityModel, reports: Sequence[ReadReport]) -> list[str]:
    """Return a line if efforts are read with other scales than the model was fitted with."""
    fitted: dict[str, float] = {}
    for bag in model.provenance.get('bags', ()):
        if 'effort_scale' in bag:  # which files of earlier releases do not say
            fitted.update({joint: bag['effort_scale'].get(joint, 1.0) for joint in model.joints})
    differ = sorted({joint for report in reports for joint, scale in fitted.items()
                     if report.effort_scale.get(joint, 1.0) != scale}, key=model.joints.index)
    if not differ:
        return []
    wanted = ','.join(f'{joint}={fitted[joint]:g}' for joint in differ)
    return [f'the model was fitted with another scale of the effort of {", ".join(differ)}: '
            f'unless the driver has changed, read with --effort-scale {wanted}']
