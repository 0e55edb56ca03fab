"""What `gravity_comp cut` takes."""

from __future__ import annotations

import argparse

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp cut run1.mcap -o start.mcap --to 60            the first minute
  gravity_comp cut run1.mcap -o middle.mcap --from 20 --to 50 --joints shoulder,elbow
  gravity_comp cut run1.mcap -o part.mcap --split 60,120      part-1.mcap, part-2.mcap, part-3.mcap

Times are in s from the first sample. Efforts are written as they were recorded, and stamps stay,
so that the parts are on one clock. Messages that cannot be used are left out, as every verb does.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `cut`."""
    parser.add_argument('bag', metavar='BAG', type=arguments.recording,
                        help='an MCAP file, a rosbag2 folder or a .db3 file')
    parser.add_argument('-o', '--output', metavar='OUT.mcap', type=arguments.mcap_file,
                        required=True, help='file to write; an older one is replaced')
    parser.add_argument('--from', dest='begin', metavar='S', type=arguments.finite, default=0.0,
                        help='leave out what is before (default: 0)')
    parser.add_argument('--to', dest='end', metavar='S', type=arguments.positive, default=None,
                        help='leave out what is after (default: the end)')
    parser.add_argument('--split', metavar='S,S,...', type=times, default=(),
                        help='cut at these times, into files with a number')
    parser.add_argument('--topic', metavar='TOPIC', default=None,
                        help='topic of the joint states (default: the only one in the bag, or '
                        '/joint_states)')
    parser.add_argument('--joints', metavar='A,B,...', type=arguments.joint_list, default=None,
                        help='keep these joints, in this order (default: all)')
    arguments.add_json(parser)


def times(text: str) -> tuple[float, ...]:
    """Return the rising times in `60,120`."""
    found = tuple(arguments.positive(part) for part in text.split(','))
    if any(later <= earlier for earlier, later in zip(found, found[1:])):
        raise argparse.ArgumentTypeError(f'{text!r}: the times must rise')
    return found
