"""`gravity_comp cut`: extract parts of a recording by time and joints."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from gravity_comp_ros.commands import next_step, reading
from gravity_comp_ros.commands.terminal import Answer
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.facts.fact import Kind
from gravity_comp_ros.printable import counted, shown_names
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions, Recording
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag


@dataclass(frozen=True)
class Part:
    """A part of a recording: its file and samples, from `begin` to `end` s."""

    path: Path
    topic: JointTopic
    start_ns: int
    begin: float
    end: float


def run(args: argparse.Namespace) -> Answer:
    """Read, cut and write."""
    # The parts are written as recorded.
    recording = read_bag(args.bag, ReadOptions(
        args.topic, args.joints, accept=tuple(kind.value for kind in Kind)))
    parts = cut(recording, args.output, args.begin, args.end, args.split)
    for part in parts:
        if part.path.exists() and part.path.resolve() == args.bag.resolve():
            raise OptionError(f'{part.path} is the input recording; choose another name')
    for part in parts:
        write_bag(part.path, [part.topic], part.start_ns)
    document = {'input': str(args.bag), 'parts': [
        {'output': str(part.path), 'n_samples': len(part.topic.t), 'from': part.begin,
         'to': part.end, 'joints': list(part.topic.joints)} for part in parts]}
    return Answer(document, [*reading.bag_lines([recording.report]), *(
        f'wrote {part.path}: {counted(len(part.topic.t), "sample")} from {part.begin:.6g} to '
        f'{part.end:.6g} s, joints {shown_names(part.topic.joints)}' for part in parts),
        *next_step.check_recordings(*(part.path for part in parts))])


def cut(recording: Recording, output: Path, begin: float = 0.0, end: float | None = None,
        split: tuple[float, ...] = ()) -> list[Part]:
    """
    Return the parts of a recording between times in s from its first sample.

    A part includes its begin and excludes its end; the last part includes its end.

    :raises OptionError: if the times do not increase.
    :raises DataError: if a part has no sample.
    """
    samples, report = recording.samples, recording.report
    last = float(samples.t[-1])
    bounds = [begin, *split, last if end is None else end]
    if any(later <= earlier for earlier, later in zip(bounds, bounds[1:])):
        raise OptionError('the times --from, --split and --to (or the end of the recording at '
                          f'{last:.6g} s) must increase; they are '
                          f'{", ".join(f"{x:g}" for x in bounds)}')
    parts = []
    for number, (start, stop) in enumerate(zip(bounds, bounds[1:]), start=1):
        final = number == len(bounds) - 1
        inside = (samples.t >= start) & ((samples.t <= stop) if final else (samples.t < stop))
        if not inside.any():
            raise DataError(f'no samples between {start:g} and {stop:g} s; the recording '
                            f'lasts {last:.6g} s')
        t = samples.t[inside]
        path = output if len(bounds) == 2 else output.with_stem(f'{output.stem}-{number}')
        velocity = samples.qd[inside] if report.velocity == 'measured' else None
        topic = JointTopic(report.topic, samples.names, t - t[0], samples.q[inside], velocity,
                           samples.tau[inside])
        parts.append(Part(path, topic, report.start_ns + round(float(t[0]) * 1e9), float(t[0]),
                          float(t[-1])))
    return parts
