"""Files that verbs write: their names, and what keeps them from being written."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import os
from pathlib import Path

from gravity_comp_ros.errors import ModelFileError, OptionError


def mcap_file(text: str) -> Path:
    """Return the path of an MCAP file to write; another ending is surely a slip."""
    path = Path(text)
    if path.suffix != '.mcap':
        raise argparse.ArgumentTypeError(f'{text} does not end in .mcap')
    return path


def check_model_target(target: Path, others: Sequence[Path]) -> None:
    """
    Refuse before a long fit what could not be written after it.

    :param others: files that the same command reads or writes.
    :raises OptionError: if the target is one of the others.
    :raises ModelFileError: if the model could not be written there.
    """
    for other in others:
        if target.resolve() == other.resolve():
            raise OptionError(f'{target} is named twice, as the model and as {other}')
    folder = target.resolve().parent
    if not folder.is_dir():
        raise ModelFileError(f'cannot write {target}: there is no folder {folder}')
    if target.is_dir() or not os.access(folder, os.W_OK):
        raise ModelFileError(f'cannot write {target}: permission denied or a folder')
    # Replacing a file needs no right to write it, so a read-only model must be asked for.
    if target.exists() and not target.stat().st_mode & 0o222:
        raise ModelFileError(f'cannot write {target}: it is read-only')


def json_file(args: argparse.Namespace) -> list[Path]:
    """Return the file that --json names, if it names one."""
    return [Path(args.json)] if args.json and args.json != '-' else []
