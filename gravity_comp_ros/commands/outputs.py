"""Check of output files before any work: no output is an input, and all are writable."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import combinations
import os
from pathlib import Path
import re

from gravity_comp_ros.commands.arguments import recording
from gravity_comp_ros.errors import OptionError

# Arguments with a file or folder to write; other files are inputs.
OUTPUTS = ('output', 'json', 'html')
_METAVAR = re.compile(r'\.\w|FILE|MOTION')


def check_outputs(args: argparse.Namespace) -> None:
    """
    Refuse outputs that are not writable or would overwrite an input.

    Verbs that change a model in place set `rewrites_model`; verbs that create an output folder
    set `output_is_folder`.

    :raises OptionError: if an output is an input, or another output, or cannot be written.
    """
    outputs = {name: (option, path) for name, option, path in _paths(args) if name in OUTPUTS}
    rewrites = getattr(args, 'rewrites_model', False)
    for source, given, path in _paths(args):
        for name, (option, output) in outputs.items():
            if source not in OUTPUTS and not (rewrites and (name, source) == ('output', 'model')):
                _check_pair(option, output, source, given, path)
    for (first, path), (second, other) in combinations(outputs.values(), 2):
        if _same(path, other):
            raise OptionError(f'{first} and {second} both name {path}: give each its own file')
    if rewrites and not args.dry_run and args.output is None:
        outputs['model'] = '--model', args.model
    for name, (_, path) in outputs.items():
        if not (name == 'output' and getattr(args, 'output_is_folder', False)):
            _check_writable(path)


def names_file(action: argparse.Action) -> bool:
    """Return whether an argument is a file or folder, by its type or its metavar."""
    return action.type in (Path, recording) or bool(_METAVAR.search(str(action.metavar)))


def _paths(args: argparse.Namespace) -> Iterator[tuple[str, str, Path]]:
    """Yield each file or folder of the arguments: its argument, option or metavar, and path."""
    for action in filter(names_file, args.parser._actions):
        value = getattr(args, action.dest, None)
        for item in value if isinstance(value, (list, tuple)) else [value]:
            if isinstance(item, (str, Path)) and item not in ('', '-'):
                yield action.dest, (*action.option_strings, action.metavar)[0], Path(item)


def _check_pair(option: str, output: Path, source: str, given: str, path: Path) -> None:
    if _same(output, path):
        raise OptionError(f'{option} {output} is also {given} and would be overwritten; name '
                          f'another file')
    if source.startswith('bag') and path.is_dir() and output.resolve().parent == path.resolve():
        raise OptionError(f'{option} {output} is inside the folder of the recording; name a file '
                          f'elsewhere')


def _same(first: Path, second: Path) -> bool:
    # Two names can be hard links to one file, or differ only in case.
    if first.exists() and second.exists():
        return first.samefile(second)
    return first.resolve() == second.resolve()


def _check_writable(path: Path) -> None:
    folder = path.resolve().parent
    if not folder.is_dir():
        raise OptionError(f'cannot write {path}: there is no folder {folder}')
    if path.is_dir():
        raise OptionError(f'cannot write {path}: it is a folder')
    if not os.access(folder, os.W_OK):
        raise OptionError(f'cannot write {path}: permission denied in {folder}')
    # Replacing a file requires no write permission on it, so check it explicitly.
    if path.exists() and not path.stat().st_mode & 0o222:
        raise OptionError(f'cannot write {path}: it is read-only')
