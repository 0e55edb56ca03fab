"""Check of output files before any work: no output is an input, and all are writable."""

from __future__ import annotations

import argparse
from itertools import combinations
import os
from pathlib import Path

from gravity_comp_ros.errors import OptionError

# Arguments with a file or folder to write; all other paths of a verb are inputs.
_OUTPUTS = ('output', 'json', 'html')


def check_outputs(args: argparse.Namespace) -> None:
    """
    Refuse outputs that cannot be written, or are an input or in a folder that the verb uses.

    Verbs that may write where they read set `in_place` to the name of that argument; verbs that
    create an output folder set `output_is_folder`.

    :raises OptionError: if an output is refused.
    """
    paths = {name: [path for path in (value if isinstance(value, (list, tuple)) else [value])
                    if isinstance(path, Path)] for name, value in vars(args).items()}
    outputs = [path for name in _OUTPUTS for path in paths.pop(name, ())]
    inputs = [path for values in paths.values() for path in values]
    place = getattr(args, getattr(args, 'in_place', ''), None)
    for output in outputs:
        if any(_same(output, path) for path in inputs
               if not (path is place and output is args.output)):
            raise OptionError(f'{output} is an input and would be overwritten; name another file')
    for first, second in combinations(outputs, 2):
        if _same(first, second):
            raise OptionError(f'two outputs both name {first}: give each its own file')
    own = [args.output] if getattr(args, 'output_is_folder', False) else []
    files = [path for path in outputs if path not in own]
    for path, folder in ((path, folder) for path in files for folder in (*inputs, *own)):
        if folder is not None and folder.is_dir() and path.resolve().parent == folder.resolve():
            raise OptionError(f'{path} is inside the folder {folder} that this verb uses; name a '
                              f'file elsewhere')
    for path in files if place is None or args.output or args.dry_run else [*files, place]:
        _check_writable(path)


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
