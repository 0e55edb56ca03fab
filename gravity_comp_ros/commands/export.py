"""
Write a model as C source, into a URDF or MJCF, or as payload of a drive.

targets:
  c         one C99 header and source in the folder -o, for a controller without Python
            (docs/realtime.md)
  urdf      the file --urdf with the masses and centres of mass nearest to its own that give the
            gravity torque of the model; Coulomb and viscous friction as <dynamics>
  mjcf      the same for a MuJoCo file, --mjcf
  payload   mass and centre of mass of the last `update --urdf`, as lines for the drives of UR,
            Franka, KUKA, xArm and Kinova; in the frame --flange of --urdf

Inertias about the centres of mass, axes and zero angles stay those of the description. Comments
and layout of the file stay byte for byte.

For example:
  gravity_comp export arm.json --to c -o src/
  gravity_comp export left.json --to c --prefix left -o src/    two arms in one program
  gravity_comp export arm.json --to urdf --urdf robot.urdf -o corrected.urdf
  gravity_comp export arm.json --to mjcf --mjcf scene.xml -o corrected.xml
  gravity_comp export tool.json --to payload --urdf robot.urdf --flange tool0
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
import shlex
from typing import Any

from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.commands import arguments, next_step, reading, terminal
from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.robot_tree import read_text
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.effects.motion_direction import COMPENSATION_SPEED
from gravity_comp_ros.effects.predict import static_effects, torque_of
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.export.c_source import c_source
from gravity_comp_ros.export.changed_description import ChangedDescription, written_friction
from gravity_comp_ros.export.payload_lines import drive_lines, in_frame, load_of
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import checksum, load_model
import numpy as np

# Lines to show, and the keys of the JSON.
Result = tuple[Sequence[terminal.Line], dict[str, Any]]
# Options of each target besides -o.
_OPTIONS = {'c': ('prefix',), 'urdf': ('urdf', 'fixed'), 'mjcf': ('mjcf',),
            'payload': ('urdf', 'fixed', 'flange')}
# Keys of the JSON that not every target has.
_NULL = dict.fromkeys(('parameters', 'links', 'difference', 'payload', 'in_motion', 'add'))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `export`."""
    parser.add_argument('model', metavar='MODEL.json', type=Path, help='model to export')
    parser.add_argument('--to', choices=('c', 'urdf', 'mjcf', 'payload'), required=True,
                        help='target, see below')
    parser.add_argument('-o', '--output', metavar='PATH', type=Path,
                        help='folder (c, created if missing) or file (urdf, mjcf) to write')
    parser.add_argument('--prefix', metavar='NAME',
                        help='c: prefix of all names and files (default: gc)')
    arguments.add_urdf(parser, 'urdf: description to correct; payload: description with the '
                       'flange')
    parser.add_argument('--mjcf', metavar='FILE.xml', type=Path,
                        help='mjcf: description to correct')
    parser.add_argument('--flange', metavar='LINK',
                        help='payload: link of --urdf whose frame the drive uses, such as tool0 '
                        '(default: the link of the last joint)')
    parser.set_defaults(output_is_folder=True)
    arguments.add_json(parser)


def run(args: argparse.Namespace) -> terminal.Answer:
    """Export the model, and show the result."""
    _check_usage(args)
    model = load_model(args.model)
    targets: Mapping[str, Callable[[argparse.Namespace, GravityModel], Result]] = {
        'c': _c, 'urdf': _description, 'mjcf': _description, 'payload': _payload}
    lines, result = targets[args.to](args, model)
    document = {'to': args.to, 'model': str(args.model), 'sha256': checksum(model),
                'joints': list(model.joints), **_NULL, 'warnings': [], **result}
    add = document['add'] = _add_command(args, model, result['not_added'])
    warnings = [*(f'{target} is left out: {why}{_at_rest(model, target)}'
                  for target, why in result['left_out'].items()),
                *document['warnings']]
    if add is not None:
        listed = ', '.join(f'{effect.target} ({wording.coefficients(effect.coefficients, 3)})'
                           for effect in model.fitted.effects
                           if effect.target in result['not_added'])
        warnings.append(f'found in the recordings, but not exported, since it is not added to the '
                        f'model: {listed}')
        lines = [*lines, *next_step.lines(
            'add the effects found that `gravity_comp diagnose` establishes, with the recordings '
            'and reading options of the fit, and export again', add)]
    return terminal.Answer(document, lines, warnings)


def _at_rest(model: GravityModel, target: str) -> str:
    """Return the largest torque of an effect of a model at rest, in its trained range."""
    q = random_poses(model.n_joints, model.coverage.q_min, model.coverage.q_max)
    torque = torque_of(model, static_effects(
        effect for effect in model.applied.effects if effect.target == target),
        JointSamples.at_rest(model.joints, q))
    held = ', '.join(f'{size:.3g} N·m of {joint}' for joint, size in zip(
        model.joints, np.abs(torque).max(axis=0)) if size > 0.0)
    return f'. It holds up to {held} at rest, which the output lacks' if held else ''


def _add_command(args: argparse.Namespace, model: GravityModel,
                 targets: Sequence[str]) -> str | None:
    """Return the command that adds effects to the model, None without any."""
    bags = [str(bag['name']) for bag in model.provenance.get('bags', ())] or ['BAG...']
    return shlex.join(['gravity_comp', 'add', ','.join(targets), *bags, '--model',
                       str(args.model)]) if targets else None


def _only_found(model: GravityModel) -> GravityModel:
    """Return the model with the effects that were found and not added, in place of its own."""
    return replace(model, applied=model.fitted)


def _check_usage(args: argparse.Namespace) -> None:
    own = _OPTIONS[args.to]
    for options in _OPTIONS.values():
        for name in options:
            if name not in own and getattr(args, name) not in (None, {}):
                args.parser.error(f'--{name} is not for --to {args.to}')
    if (args.output is None) != (args.to == 'payload'):
        args.parser.error(f'--to {args.to} needs -o PATH' if args.output is None else
                          '--to payload prints its lines; it takes no -o')
    if args.flange is not None and args.urdf is None:
        args.parser.error('--flange is a link of a description: name it with --urdf')
    if args.to in ('urdf', 'mjcf') and getattr(args, args.to) is None:
        args.parser.error(f'--to {args.to} needs the description to correct: --{args.to} FILE')
    if args.to in ('urdf', 'mjcf') and args.output.suffix not in (
            '', getattr(args, args.to).suffix):
        args.parser.error(f'-o {args.output} does not end as the description does: '
                          f'{getattr(args, args.to)}')


def _c(args: argparse.Namespace, model: GravityModel) -> Result:
    code = c_source(model, args.prefix or 'gc')
    try:
        args.output.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        reason = (problem.strerror or 'not possible').lower()
        raise GravityCompError(f'cannot write to the folder {args.output}: {reason}') from problem
    files = {args.output / code.source_name: code.source,
             args.output / code.header_name: code.header}
    for path, text in files.items():
        write_atomically(path, text.encode(), GravityCompError)
    parameters = code.parameters
    effects = f', with {", ".join(code.effects)}' if code.effects else ''
    return [*(f'wrote {path}' for path in sorted(files)),
            f'{model.formulation} of {model.n_joints} joints{effects}; '
            f'{len(parameters.values)} parameters, layout 0x{parameters.layout:08x}',
            *(f'{target} persists at rest; here it acts in motion only, as '
              f'tanh(qd / {COMPENSATION_SPEED} rad/s)' for target in code.in_motion)], {
            'files': sorted(map(str, files)), 'effects': code.effects, 'left_out': code.left_out,
            'in_motion': code.in_motion, 'not_added': c_source(_only_found(model)).effects,
            'parameters': {'layout': parameters.layout, 'labels': parameters.labels}}


def _description(args: argparse.Namespace, model: GravityModel) -> Result:
    changed = _changed(args, model)
    write_atomically(args.output, changed.data, GravityCompError)
    difference = TextTable(
        ('joint', 'largest difference from the model N·m before', 'after'),
        [(joint, f'{changed.before[joint]:.4f}', f'{value:.4f}')
         for joint, value in changed.after.items()])
    return [_link_table(changed), '', difference, '', *changed.notes, f'wrote {args.output}'], {
            'files': [str(args.output)], 'effects': changed.effects, 'left_out': changed.left_out,
            'not_added': [effect.target for effect in written_friction(
                _only_found(model), model.joints)],
            'links': changed.links, 'warnings': [
                f'the recordings of the model do not determine the gravity torque of {joint}: the '
                f'masses of the description decide, and differ from the model by up to '
                f'{changed.after[joint]:.3g} N·m. Fit a motion that moves the other joints as '
                f'well, and export again' for joint in changed.uncertain],
            'difference': {joint: {'before': changed.before[joint], 'after': value}
                           for joint, value in changed.after.items()}}


def _changed(args: argparse.Namespace, model: GravityModel) -> ChangedDescription:
    if args.to == 'mjcf':
        from gravity_comp_ros.export.mjcf_file import changed_mjcf
        return changed_mjcf(args.mjcf, read_text(args.mjcf, 'MJCF'), model)
    from gravity_comp_ros.export.urdf_file import changed_urdf
    return changed_urdf(read_text(args.urdf), model, str(args.urdf), args.fixed)


def _payload(args: argparse.Namespace, model: GravityModel) -> Result:
    payload, updates = load_of(model), model.provenance['updates']
    if args.flange is not None:
        payload = in_frame(payload, reading.arm_of_model(args, model), args.flange)
    lines = drive_lines(payload)
    listing: list[terminal.Line] = [
        payload.sentence(), f'that is what the arm carries after {len(updates)} '
        f'update{"s" * (len(updates) > 1)}, in addition to its load in the fit of the model',
        'the inertia is not identified and is 0 in these lines; none was '
        'tested on its robot']
    for line in lines:
        listing += ['', f'{line.maker} ({line.source})', terminal.command(line.line)]
    return listing, {
            'files': [], 'effects': [], 'left_out': {}, 'not_added': [],
            'warnings': [text for update in updates for text in update['warnings']],
            'payload': {**vars(payload), 'lines': lines}}


def _link_table(changed: ChangedDescription) -> TextTable:
    rows = []
    for name, link in changed.links.items():
        shift = sum((a - b) ** 2 for a, b in zip(link.centre, link.centre_before)) ** 0.5
        rows.append((name, f'{link.mass_before:.3f}', f'{link.mass:.3f}',
                     ' '.join(f'{x:+.4f}' for x in link.centre), f'{1e3 * shift:.1f}'))
    return TextTable(('link', 'mass kg before', 'after', 'centre m', 'moved by mm'), rows,
                     'centres of mass in the frame of each link')
