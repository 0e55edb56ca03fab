"""Bags named on the command line become gated samples, and lines that say what was read."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from gravity_comp_ros.commands.arguments import gate_options, Gated, gated, read_options, slow_only
from gravity_comp_ros.commands.terminal import ProgressCallback
from gravity_comp_ros.data.holdout import Block
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.bag import read_bag, ReadReport
from gravity_comp_ros.recordings.parallel import read_gated_bags


@dataclass(frozen=True)
class Loaded:
    """
    What was read from each bag, all samples, and those of all that passed the gate.

    `samples` are those of the gate alone if they came from `load_slow`.
    """

    reports: tuple[ReadReport, ...]
    gated: Gated
    samples: JointSamples

    def ordered(self, joints: Sequence[str]) -> Loaded:
        """Return the same with the joints in another order."""
        gated = replace(self.gated, samples=self.gated.samples.joints(joints))
        return replace(self, gated=gated, samples=self.samples.joints(joints))

    def to_json(self) -> dict[str, Any]:
        return {'bags': [bag_json(report) for report in self.reports],
                'gate': self.gated.to_json()}

    def lines(self) -> list[str]:
        """Return plain lines for a person; they may hold text from the bags."""
        return [*bag_lines(self.reports), self.gated.sentence()]


def load(args: argparse.Namespace, report: ProgressCallback) -> Loaded:
    """
    Return the samples of `args.bags`, gated as the arguments ask.

    :raises BagError: if a bag cannot be read.
    :raises ModelMismatchError: if two bags are of different robots.
    :raises DataError: if nothing passes the gate.
    """
    gate_options(args)   # what is wrong with them is said before a long read
    reports, samples = read_all(args, report)
    return Loaded(reports, gated(args, samples), samples)


def load_slow(args: argparse.Namespace, report: ProgressCallback) -> Loaded:
    """
    Return the same for those who need no samples but the gated ones.

    The others are never held in memory, and large bags are read in parallel processes.

    :raises BagError: if a bag cannot be read.
    :raises ModelMismatchError: if two bags are of different robots.
    :raises DataError: if nothing passes the gate.
    """
    if args.all_samples:
        return load(args, report)
    bags = read_gated_bags(args.bags, read_options(args), gate_options(args))
    recordings = []
    for number, path in enumerate(args.bags):
        report(f'read {path.name}', number / len(args.bags))
        recordings.append(next(bags))
    samples = concatenate(recording.samples for recording in recordings)
    reports = tuple(recording.report for recording in recordings)
    dropped = sum((Counter(recording.dropped) for recording in recordings), Counter())
    gated = slow_only(samples, sum(r.n_samples for r in reports), dropped, gate_options(args))
    return Loaded(reports, gated, samples)


def read_all(args: argparse.Namespace, report: ProgressCallback
             ) -> tuple[tuple[ReadReport, ...], JointSamples]:
    """
    Return a report on each of `args.bags`, and all their samples, fast ones too.

    :raises BagError: if a bag cannot be read.
    :raises ModelMismatchError: if two bags are of different robots.
    """
    options = read_options(args)
    recordings = []
    for number, path in enumerate(args.bags):
        report(f'read {path.name}', number / len(args.bags))
        recordings.append(read_bag(path, options))
    samples = concatenate(recording.samples for recording in recordings)
    return tuple(recording.report for recording in recordings), samples


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


def held_out_blocks(model: GravityModel, reports: Sequence[ReadReport],
                    guard: float = 0.0) -> list[Block]:
    """Return what `fit --holdout` kept of these bags out of the model, and `guard` s about it."""
    blocks = (model.provenance.get('holdout') or {}).get('blocks', ())
    return [Block(run, block['start'] - guard, block['end'] + guard)
            for run, report in enumerate(reports)
            for block in blocks if block['sha256'] == report.sha256]


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


def bag_json(report: ReadReport) -> dict[str, Any]:
    """Return what identifies and describes a bag, ready for JSON."""
    return {'name': report.path.name, 'sha256': report.sha256, 'topic': report.topic,
            'n_messages': report.n_messages, 'n_samples': report.n_samples,
            'dropped': dict(report.dropped), 'velocity': report.velocity,
            'rate_hz': report.rate_hz, 'duration_s': report.duration_s,
            'effort_scale': dict(report.effort_scale),
            'notes': list(report.notes)}
