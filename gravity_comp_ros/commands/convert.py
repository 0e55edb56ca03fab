"""`gravity_comp convert`: convert a table of measurements to a bag."""

from __future__ import annotations

import argparse
from dataclasses import fields

from gravity_comp_ros.commands import next_step
from gravity_comp_ros.commands.terminal import Answer
from gravity_comp_ros.printable import counted, shown_names
from gravity_comp_ros.recordings.mcap_writer import write_bag
from gravity_comp_ros.recordings.table import read_table, TableOptions


def run(args: argparse.Namespace) -> Answer:
    options = TableOptions(**{one.name: getattr(args, one.name) for one in fields(TableOptions)})
    converted = read_table(args.table, options, args.topic)
    write_bag(args.output, [converted.topic], converted.start_ns)
    topic = converted.topic
    bad = [f'{counted(converted.dropped, "bad row")} omitted'] if converted.dropped else []
    return Answer(
        {'input': str(args.table), 'output': str(args.output), 'joints': topic.joints,
         'n_samples': len(topic.t), 'duration_s': topic.t[-1],
         'velocity': topic.velocity is not None, 'dropped_rows': converted.dropped,
         'notes': converted.notes},
        [f'wrote {args.output}: {counted(len(topic.t), "sample")} over {topic.t[-1]:.4g} s, '
         f'joints {shown_names(topic.joints)}', *next_step.check_recordings(args.output)],
        [*bad, *converted.notes])
