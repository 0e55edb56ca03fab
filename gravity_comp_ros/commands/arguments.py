"""Parsers of the verbs, and arguments of several verbs with their options of the core."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection
from importlib import import_module
import math
from pathlib import Path
import re
from typing import Any, NoReturn

from gravity_comp_ros.api.axes import ArmOptions, NO_DESCRIPTION
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.printable import printable
from gravity_comp_ros.recordings.read_options import BAG_UNITS, OPTIONS, ReadOptions
from gravity_comp_ros.recordings.units import ANGLE_HELP, radians_per_unit

DRAWN = 'robot description for the three-dimensional drawing of the arm'


def number(kind: type[float] | type[int], what: str,
           accepts: Callable[[float], bool]) -> Callable[[str], Any]:
    """Return the type of a finite number that `accepts` is true of; `what` describes it."""
    def parsed(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and accepts(value)):
            raise argparse.ArgumentTypeError(f'{text!r} is not {what}')
        return value
    return parsed


finite = number(float, 'a finite number', lambda value: True)
positive = number(float, 'a number above 0', lambda value: value > 0.0)
nonzero = number(float, 'a number other than 0', bool)
count = number(int, 'a positive integer', lambda value: value > 0)


class Parser(argparse.ArgumentParser):
    """An argument parser without abbreviated options; its errors are printable."""

    def __init__(self, *args: object, **kwargs: object) -> None:
        kwargs.setdefault('allow_abbrev', False)
        kwargs.setdefault('formatter_class', argparse.RawDescriptionHelpFormatter)
        super().__init__(*args, **kwargs)  # type: ignore[arg-type]

    def error(self, message: str) -> NoReturn:
        """Exit with status 2 and one line."""
        self.exit(2, f'{self.prog}: {printable(message)} (see `{self.prog} --help`)\n')


def verb_parser(verb: str) -> Parser:
    """Return the parser of a verb; the docstring of its module is the help text."""
    module = import_module(f'gravity_comp_ros.commands.{verb}')
    text, _, epilog = (module.__doc__ or '').lstrip().partition('\n\n')
    parser = Parser(prog=f'gravity_comp {verb}', description=text, epilog=epilog)
    module.add_arguments(parser)
    return parser


class _Merge(argparse.Action):
    """Mapping that a repeated option extends."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace,
                 values: Any, option_string: str | None = None) -> None:
        setattr(namespace, self.dest, {**getattr(namespace, self.dest), **values})


def _add_mapping(parser: argparse._ActionsContainer, option: str, shape: str,
                 value: Callable[[str], Any], use: str) -> None:
    """Add an option `NAME=VALUE,...` that may be repeated; `value` is the type of one value."""
    parser.add_argument(option, metavar=shape, type=mapping(value, shape.removesuffix(',...')),
                        action=_Merge, default={}, help=use)


def add_bags(parser: argparse.ArgumentParser, nargs: str | None = '+') -> None:
    """Add the positional `bags` (a list of paths); with `nargs` None a single `bag`."""
    name = 'bag' if nargs is None else 'bags'
    parser.add_argument(
        name, metavar='BAG', nargs=nargs, type=recording,
        help='MCAP file, rosbag2 folder or bare .db3 file'
        + ('' if nargs is None else '; several bags are several runs'))


def add_model(parser: argparse.ArgumentParser, use: str, required: bool = True) -> None:
    """Add --model; `use` is its help text."""
    parser.add_argument('--model', metavar='MODEL.json', type=Path, required=required, help=use)


def add_mcap_output(parser: argparse.ArgumentParser) -> None:
    """Add -o for a recording."""
    parser.add_argument('-o', '--output', metavar='OUT.mcap', type=file_type('.mcap'),
                        required=True, help='file to write; an existing file is replaced')


def add_recording_output(parser: argparse.ArgumentParser) -> None:
    """Add -o, the topic and --json of a verb that makes a recording."""
    add_mcap_output(parser)
    parser.add_argument('--topic', default='/joint_states', help='(default: /joint_states)')
    add_json(parser)


def add_topic_and_joints(parser: argparse._ActionsContainer, joints: bool = True) -> None:
    """Add --topic, and --joints unless a model determines the joints."""
    parser.add_argument('--topic', metavar='TOPIC',
                        help='joint state topic (default: the only one in the bag, or '
                        '/joint_states)')
    if joints:
        parser.add_argument('--joints', metavar='A,B,...', type=joint_list,
                            help='joints to use, in this order (default: all, as recorded)')


def add_reading(parser: argparse.ArgumentParser, joints: bool = True) -> None:
    """
    Add the arguments for `read_options`.

    :param joints: whether to add --joints; False if a model determines the joints.
    """
    parser.set_defaults(joints=None)
    group = parser.add_argument_group('reading')
    add_topic_and_joints(group, joints)
    _add_mapping(group, '--effort-scale', 'JOINT=VALUE', nonzero,
                 'N·m per unit of effort, sign included, e.g. elbow=-1 or a=0.12,b=0.12; may be '
                 'repeated (default: 1)')
    group.add_argument('--effort-unit', choices=BAG_UNITS, default='Nm',
                       help='unit of effort in the bag (default: %(default)s); for motor '
                       'current give --effort-scale')
    _add_mapping(group, '--rated-torque', 'JOINT=NM', nonzero,
                 'torque of each joint at 100 %%, for effort in percent or permille of it, e.g. '
                 'a=10,b=30; may be repeated')
    group.add_argument('--position-unit', metavar='UNIT', type=_position_units, default='rad',
                       help=f'unit of angles and speeds in the bag: {ANGLE_HELP}; of single '
                       'joints as JOINT=UNIT,... (default: %(default)s)')
    group.add_argument('--accept', metavar='FACT,...', type=joint_list, default=(),
                       help='read the recording as it is in spite of these facts, e.g. '
                       'effort_spikes,effort_unit: nothing is corrected or refused for them '
                       '(`info` lists the facts)')
    _add_mapping(group, '--rename', 'OLD=NEW,...', str,
                 'rename joints of the bag, e.g. to those of a URDF; the other options and the '
                 'model use the new names')
    group.add_argument('--reverse', metavar='A,B,...', type=joint_list, default=(),
                       help='joints that turn against their axis in the description: position, '
                       'velocity and effort get the opposite sign')
    _add_mapping(group, '--zero', 'JOINT=RAD', finite,
                 'recorded position of the zero in the description; may be repeated')
    group.add_argument('--differentiate', action='store_true',
                       help='compute velocities from positions, for a driver whose velocities '
                       'are 0 or wrong; always done for a bag without velocities')


def read_options(args: argparse.Namespace) -> ReadOptions:
    """Return the `ReadOptions` of the arguments of `add_reading`."""
    return ReadOptions(**{name: getattr(args, name) for name in OPTIONS})


def add_gate(parser: argparse.ArgumentParser, title: str = 'slow-motion gate') -> None:
    """Add --max-speed, --rate and --all-samples, for `gate`."""
    group = parser.add_argument_group(title)
    group.add_argument('--max-speed', metavar='RAD/S', type=positive,
                       help='maximum joint speed of a sample (default: 0.15)')
    group.add_argument('--rate', metavar='HZ', type=positive,
                       help='maximum number of samples per second of slow motion (default: 5)')
    group.add_argument('--all-samples', action='store_true',
                       help='use every sample, fast or slow')


def gate(args: argparse.Namespace) -> GateOptions | None:
    """
    Return the gate of the arguments, None with --all-samples.

    :raises OptionError: if they contradict each other.
    """
    given = {key: value for key, value in (('max_speed', args.max_speed), ('rate_hz', args.rate))
             if value is not None}
    if args.all_samples and given:
        raise OptionError('--all-samples disables the gate: omit --max-speed and --rate')
    return None if args.all_samples else GateOptions(**given)


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add --json [FILE]: `args.json` is None, '-' for standard output, or a path."""
    parser.add_argument(
        '--json', metavar='FILE.json', nargs='?', const='-', type=_json_target,
        help='print only the result, as JSON; with a file name, write it there')


def _json_target(text: str) -> Path | str:
    # `--json BAG` would overwrite the bag.
    if text != '-' and not text.endswith('.json'):
        raise argparse.ArgumentTypeError(
            f'{text} does not end in .json: name a .json file, or put --json after the bags')
    return text if text == '-' else Path(text)


def add_urdf(parser: argparse._ActionsContainer, use: str, or_none: bool = False,
             fixed: bool = True) -> None:
    """
    Add --urdf, by default the description in the recordings; `use` is its help text.

    :param or_none: whether `none` selects no description, see `arm_options`.
    :param fixed: whether to add --fixed, the positions of joints that are not learned.
    """
    parser.add_argument(
        '--urdf', metavar='FILE.urdf' + '|none' * or_none,
        type=file_type(names=(NO_DESCRIPTION,)) if or_none else Path,
        help=f'{use} (default: /robot_description in the recordings'
        + ('; its masses are not used; none: no description)' if or_none else ')'))
    if fixed:
        _add_mapping(parser, '--fixed', 'JOINT=VALUE', finite,
                     'position of a joint of the description that is not recorded, rad or m, '
                     'e.g. waist=0.3; may be repeated (default: 0)')


def arm_options(args: argparse.Namespace, formulation: str | None = None) -> ArmOptions:
    """Return the robot description to use, and whether --joints gives the order of the joints."""
    return ArmOptions(formulation, args.urdf, args.fixed, args.joints is not None)


def add_page(parser: argparse.ArgumentParser, what: str = 'a report with plots') -> None:
    """Add --html FILE; `what` is on the page."""
    parser.add_argument('--html', metavar='FILE.html', type=file_type('.html', '.htm'),
                        help=f'write {what}, one self-contained file')


def file_type(*endings: str, names: Collection[str] = ()) -> Callable[[str], Path | str]:
    """
    Return the type of a file with one of these endings, or of one of these names.

    `--html BAG` would overwrite a bag. Without endings any file is accepted.
    """
    def checked(text: str) -> Path | str:
        if text in names:
            return text
        if endings and Path(text).suffix not in endings:
            raise argparse.ArgumentTypeError(f'{text} does not end in {", ".join(endings)}' + (
                f' and is not one of {", ".join(names)}' if names else ''))
        return Path(text)
    return checked


def recording(text: str) -> Path:
    """Return the path of a recording; reject the name of an effect with a specific message."""
    if re.split('[:,]', text)[0] in all_effects() and not Path(text).exists():
        raise argparse.ArgumentTypeError(
            f'{text} is an effect: separate effects with commas and no space')
    return Path(text)


def joint_list(text: str) -> tuple[str, ...]:
    """Return the names in `A,B,...`."""
    names = tuple(part.strip() for part in text.split(','))
    if not all(names):
        raise argparse.ArgumentTypeError(f'an empty joint name in {text!r}')
    if len(set(names)) < len(names):
        raise argparse.ArgumentTypeError(f'a joint is named twice in {text!r}')
    return names


def mapping(value: Callable[[str], Any], shape: str) -> Callable[[str], dict[str, Any]]:
    """Return the type of `NAME=VALUE,...`, such as `shape`; `value` is that of one value."""
    def parsed(text: str) -> dict[str, Any]:
        values = {}
        for part in text.split(','):
            name, equals, rest = (word.strip() for word in part.rpartition('='))
            if not (name and equals and rest):
                raise argparse.ArgumentTypeError(f'{part!r} is not {shape}')
            values[name] = value(rest)
        return values
    return parsed


def position_unit(text: str) -> str:
    """Return a unit of position."""
    try:
        radians_per_unit(text)
    except OptionError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def _position_units(text: str) -> str | dict[str, str]:
    """Return a unit of position, or the units of single joints in `JOINT=UNIT,...`."""
    is_one = any('=' not in part or part.strip().startswith('ticks=') for part in text.split(','))
    return position_unit(text) if is_one else mapping(position_unit, 'JOINT=UNIT')(text)


def numbers(text: str) -> tuple[float, ...]:
    """Return the numbers in `1,-1,...`."""
    return tuple(finite(part) for part in text.split(','))
