"""`gravity_comp export`: write a model as C source, into a description, or for a drive."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.commands import terminal
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.export.c_source import c_source
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import checksum, load_model


def run(args: argparse.Namespace) -> int:
    """Export the model, and show the files."""
    model = load_model(args.model)
    result = {'to': args.to, 'model': str(args.model), 'sha256': checksum(model),
              'joints': list(model.joints), **_c(args, model)}
    if args.json:
        terminal.emit_json(result, args.json)
    return 0


def _c(args: argparse.Namespace, model: GravityModel) -> dict[str, Any]:
    folder = _required_output(args)
    code = c_source(model, args.prefix)
    _create(folder)
    files = {folder / code.source_name: code.source, folder / code.header_name: code.header}
    for path, text in files.items():
        write_atomically(path, text.encode(), GravityCompError)
    if args.json != '-':
        effects = f', with {", ".join(code.effects)}' if code.effects else ''
        terminal.say(*(f'wrote {path}' for path in sorted(files)),
                     f'{model.formulation} of {model.n_joints} joints{effects}; '
                     f'{len(code.parameters.values)} parameters, layout '
                     f'0x{code.parameters.layout:08x}')
    terminal.warn(*(f'{target} is left out: {why}' for target, why in code.left_out.items()))
    return {'files': sorted(map(str, files)), 'effects': code.effects, 'left_out': code.left_out,
            'parameters': {'layout': code.parameters.layout, 'labels': code.parameters.labels}}


def _required_output(args: argparse.Namespace) -> Path:
    if args.output is None:
        args.parser.error(f'--to {args.to} needs -o PATH')
    return Path(args.output)


def _create(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        reason = (problem.strerror or 'not possible').lower()
        raise GravityCompError(f'cannot write to the folder {folder}: {reason}') from problem
