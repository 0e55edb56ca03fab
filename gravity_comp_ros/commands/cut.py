"""
Extract a part of a recording by time and joints, or split it.

For example:
  gravity_comp cut run1.mcap -o start.mcap --to 60            the first minute
  gravity_comp cut run1.mcap -o middle.mcap --from 20 --to 50 --joints shoulder,elbow
  gravity_comp cut run1.mcap -o part.mcap --split 60,120      part-1.mcap, part-2.mcap, part-3.mcap

Times are in s from the first sample. Efforts, stamps and /robot_description are copied unchanged,
so the parts share one clock. Invalid messages are dropped, as in every verb.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

from gravity_comp_ros.commands import arguments, next_step, reading
from gravity_comp_ros.commands.terminal import Answer
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.facts.fact import Kind
from gravity_comp_ros.printable import counted, shown_names
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions, robot_description
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `cut`."""
    arguments.add_bags(parser, nargs=None)
    parser.add_argument('--from', dest='begin', metavar='S', type=arguments.finite, default=0.0,
                        help='begin of the part (default: 0)')
    parser.add_argument('--to', dest='end', metavar='S', type=arguments.positive,
                        help='end of the part (default: end of the recording)')
    parser.add_argument('--split', metavar='S,S,...', type=_times, default=(),
                        help='split at these times into numbered files')
    arguments.add_mcap_output(parser)
    arguments.add_topic_and_joints(parser)
    arguments.add_json(parser)


def run(args: argparse.Namespace) -> Answer:
    """Read, cut and write."""
    # The parts are written as recorded.
    recording = read_bag(args.bag, ReadOptions(
        args.topic, args.joints, accept=tuple(Kind)))
    report, parts = recording.report, _parts(args, recording.samples)
    for path in parts:
        if path.exists() and path.resolve() == args.bag.resolve():
            raise OptionError(f'{path} is the input recording; choose another name')
    description = robot_description(args.bag)
    for path, part in parts.items():
        velocity = part.qd if report.velocity == 'measured' else None
        write_bag(path, [JointTopic(report.topic, part.names, part.t - part.t[0], part.q, velocity,
                                    part.tau)], report.start_ns + round(1e9 * float(part.t[0])),
                  description=description)
    document = {'input': str(args.bag), 'parts': [
        {'output': str(path), 'n_samples': len(part), 'from': part.t[0], 'to': part.t[-1],
         'joints': part.names} for path, part in parts.items()]}
    return Answer(document, [*reading.bag_lines([report]), *(
        f'wrote {path}: {counted(len(part), "sample")} from {part.t[0]:.6g} to '
        f'{part.t[-1]:.6g} s, joints {shown_names(part.names)}' for path, part in parts.items()),
        *next_step.check_recordings(*parts)])


def _times(text: str) -> tuple[float, ...]:
    """Return the increasing times in `60,120`."""
    values = tuple(arguments.positive(part) for part in text.split(','))
    if any(later <= earlier for earlier, later in pairwise(values)):
        raise argparse.ArgumentTypeError(f'{text!r}: the times must increase')
    return values


def _parts(args: argparse.Namespace, samples: JointSamples) -> dict[Path, JointSamples]:
    """
    Return the parts by file; each excludes its end, but for the last one.

    :raises OptionError: if the times do not increase.
    :raises DataError: if a part has no sample.
    """
    last = float(samples.t[-1])
    bounds = [args.begin, *args.split, last if args.end is None else args.end]
    if any(later <= earlier for earlier, later in pairwise(bounds)):
        raise OptionError('the times --from, --split and --to (or the end of the recording at '
                          f'{last:.6g} s) must increase; they are '
                          f'{", ".join(f"{x:g}" for x in bounds)}')
    parts, output = {}, args.output
    for number, (start, stop) in enumerate(pairwise(bounds), start=1):
        is_last = number == len(bounds) - 1
        inside = (samples.t >= start) & ((samples.t <= stop) if is_last else (samples.t < stop))
        if not inside.any():
            raise DataError(f'no samples between {start:g} and {stop:g} s; the recording '
                            f'lasts {last:.6g} s')
        path = output if len(bounds) == 2 else output.with_stem(f'{output.stem}-{number}')
        parts[path] = samples.select(inside)
    return parts
