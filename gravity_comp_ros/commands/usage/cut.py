"""Arguments of `gravity_comp cut`."""

from __future__ import annotations

import argparse

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp cut run1.mcap -o start.mcap --to 60            the first minute
  gravity_comp cut run1.mcap -o middle.mcap --from 20 --to 50 --joints shoulder,elbow
  gravity_comp cut run1.mcap -o part.mcap --split 60,120      part-1.mcap, part-2.mcap, part-3.mcap

Times are in s from the first sample. Efforts and stamps are copied unchanged, so the parts share
one clock. Invalid messages are dropped, as in every verb.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `cut`."""
    parser.add_argument('bag', metavar='BAG', type=arguments.recording,
                        help='MCAP file, rosbag2 folder or .db3 file')
    parser.add_argument('-o', '--output', metavar='OUT.mcap', type=arguments.mcap_file,
                        required=True, help='file to write; an existing file is replaced')
    parser.add_argument('--from', dest='begin', metavar='S', type=arguments.finite, default=0.0,
                        help='begin of the part (default: 0)')
    parser.add_argument('--to', dest='end', metavar='S', type=arguments.positive, default=None,
                        help='end of the part (default: end of the recording)')
    parser.add_argument('--split', metavar='S,S,...', type=times, default=(),
                        help='split at these times into numbered files')
    parser.add_argument('--topic', metavar='TOPIC', default=None,
                        help='joint state topic (default: the only one in the bag, or '
                        '/joint_states)')
    parser.add_argument('--joints', metavar='A,B,...', type=arguments.joint_list, default=None,
                        help='joints to keep, in this order (default: all)')
    arguments.add_json(parser)


def times(text: str) -> tuple[float, ...]:
    """Return the increasing times in `60,120`."""
    values = tuple(arguments.positive(part) for part in text.split(','))
    if any(later <= earlier for earlier, later in zip(values, values[1:])):
        raise argparse.ArgumentTypeError(f'{text!r}: the times must increase')
    return values
