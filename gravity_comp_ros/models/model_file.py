"""
Model files: JSON with a format, a version and a checksum, written atomically.

The checksum is the SHA-256 of the `model` object in canonical JSON (sorted keys, no spaces). A
file that was truncated or edited by hand is refused.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.errors import GravityCompError, ModelFileError
from gravity_comp_ros.models.codec import decode, encode
from gravity_comp_ros.models.gravity_model import GravityModel

FORMAT = 'gravity_comp_ros model'
VERSION = 6
# Maximum size of a model file; ten joints with every feature take 2 MB.
_MAX_BYTES = 64 * 2 ** 20


def save_model(path: Path | str, model: GravityModel) -> None:
    """
    Write a model file; an existing one is replaced atomically.

    :raises ModelFileError: if it cannot be written, or contains values without JSON form: a number
        that is not finite, an object in the provenance.
    """
    write_atomically(Path(path), model_text(model).encode(), ModelFileError)


def model_text(model: GravityModel) -> str:
    """
    Return the content of the file of a model.

    :raises ModelFileError: if it has no form in JSON.
    """
    body = model_to_json(model)
    document = {'format': FORMAT, 'version': VERSION, 'sha256': _checksum(body), 'model': body}
    return json.dumps(document, indent=1, allow_nan=False) + '\n'


def checksum(model: GravityModel) -> str:
    """
    Return the SHA-256 that the file of this model has.

    :raises ModelFileError: if it has no form in JSON.
    """
    return _checksum(model_to_json(model))


def load_model(path: Path | str) -> GravityModel:
    """
    Read a model file.

    :raises ModelFileError: if it is missing, not a model file, of another version, or damaged.
    """
    path = Path(path)
    document = _read(path)
    if document.get('format') != FORMAT:
        raise ModelFileError(f'{path} is not a model file of this package')
    if document.get('version') != VERSION:
        raise ModelFileError(f'{path} has version {document.get("version")!r}; this program '
                             f'reads version {VERSION}. Fit the model again')
    body = document.get('model')
    if not isinstance(body, dict) or not _is_signed(body, document.get('sha256')):
        raise ModelFileError(f'{path} is damaged: its checksum does not match. Fit it again or '
                             f'use a copy')
    try:
        model: GravityModel = decode(GravityModel, body)
        return model
    except (GravityCompError, TypeError, ValueError, OverflowError,
            RecursionError) as problem:
        raise ModelFileError(f'{path} is not a valid model: {problem}') from problem


def _read(path: Path) -> dict[str, Any]:
    try:
        with path.open('rb') as stream:
            data = stream.read(_MAX_BYTES + 1)
        if len(data) > _MAX_BYTES:
            raise ModelFileError(f'{path} is too large to be a model file')
        document = json.loads(data)
    except OSError as problem:
        reason = (problem.strerror or 'unreadable').lower()
        raise ModelFileError(f'cannot read model {path}: {reason}') from problem
    except (ValueError, RecursionError) as problem:
        raise ModelFileError(f'{path} is not a model file, or it is truncated: not JSON'
                             ) from problem
    if not isinstance(document, dict):
        raise ModelFileError(f'{path} is not a model file of this package')
    return document


def _checksum(body: dict[str, Any]) -> str:
    canonical = json.dumps(body, sort_keys=True, separators=(',', ':'), allow_nan=False)
    return hashlib.sha256(canonical.encode()).hexdigest()


def _is_signed(body: dict[str, Any], checksum: object) -> bool:
    """Return whether the checksum matches the body; a body with NaN or inf has no checksum."""
    try:
        return checksum == _checksum(body)
    except (ValueError, RecursionError):
        return False


def model_to_json(model: GravityModel) -> dict[str, Any]:
    """
    Return the model as plain values, without the torques that follow from an energy.

    :raises ModelFileError: if it has no form in JSON.
    """
    body = encode(model)
    for part in (body, *(step['previous'] for step in body['history'] if step['previous'])):
        if part['energy'] is not None:
            part['torques'] = []
    try:
        # Through JSON and back, so that the checksum is that of the parsed file.
        return dict(json.loads(json.dumps(body, allow_nan=False)))
    except (TypeError, ValueError) as problem:
        raise ModelFileError(f'cannot write this model: {problem}') from problem
