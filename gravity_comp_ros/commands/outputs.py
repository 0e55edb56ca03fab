"""Check of output files before any work: no output is an input, and all are writable."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import combinations
import os
from pathlib import Path

from gravity_comp_ros.errors import OptionError

# Arguments of all verbs by their name in the namespace; a test checks that none is missing.
INPUTS = {'bags': 'a recording', 'bag': 'the recording',
          'empty': 'the recording without the weight', 'loaded': 'the recording with the weight',
          'table': 'the table', 'model': 'the model (--model)',
          'previous': 'the earlier model (--previous)',
          'urdf': 'the robot description (--urdf)', 'mjcf': 'the robot description (--mjcf)',
          'arm': 'the robot description (--arm)',
          'motion': 'the motion (--motion)', 'plan': 'the plan (--plan)',
          'folder': 'the folder of recordings', 'models': 'the folder of models (--models)',
          'tls': 'a file of TLS (--tls)'}
OUTPUTS = {'output': '-o', 'json': '--json', 'html': '--html'}


@dataclass(frozen=True)
class _Named:
    """A path, its argument, and the meaning of the argument for messages."""

    argument: str
    meaning: str
    path: Path


def check_outputs(args: argparse.Namespace) -> None:
    """
    Refuse outputs that are not writable or would overwrite an input.

    Verbs that change a model in place set `rewrites_model`; verbs that create an output folder
    set `output_is_folder`.

    :raises OptionError: if an output is an input, or another output, or cannot be written.
    """
    inputs, outputs = _given(args, INPUTS), _given(args, OUTPUTS)
    rewrites = getattr(args, 'rewrites_model', False)
    for output in outputs:
        for source in inputs:
            if not (rewrites and (output.argument, source.argument) == ('output', 'model')):
                _check_pair(output, source)
    for first, second in combinations(outputs, 2):
        if _same(first.path, second.path):
            raise OptionError(f'{first.meaning} and {second.meaning} both name {first.path}: '
                              f'give each its own file')
    if rewrites and not args.dry_run and args.output is None:
        outputs += _given(args, {'model': '--model'})
    for output in outputs:
        if not (output.argument == 'output' and getattr(args, 'output_is_folder', False)):
            _check_writable(output.path)


def _given(args: argparse.Namespace, meanings: dict[str, str]) -> list[_Named]:
    named = []
    for argument, meaning in meanings.items():
        value = getattr(args, argument, None)
        for path in value if isinstance(value, list) else [value]:
            if path not in (None, '', '-'):
                named.append(_Named(argument, meaning, Path(path)))
    return named


def _check_pair(output: _Named, source: _Named) -> None:
    if _same(output.path, source.path):
        raise OptionError(f'{output.meaning} {output.path} is also {source.meaning} and would be '
                          f'overwritten; name another file')
    inside = source.path.is_dir() and output.path.resolve().parent == source.path.resolve()
    if source.argument.startswith('bag') and inside:
        raise OptionError(f'{output.meaning} {output.path} is inside the folder of the '
                          f'recording; name a file elsewhere')


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
