"""
Model files: JSON with a format, a version and a checksum, written atomically.

The checksum is the SHA-256 of the `model` object in canonical JSON (sorted keys, no spaces). A
file that was truncated or edited by hand is refused.
"""

from __future__ import annotations

from dataclasses import asdict, replace
import hashlib
import json
from pathlib import Path
from typing import Any

from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import GravityCompError, ModelFileError
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, FORMULATIONS, GravityModel, Step
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.sparse.dictionary import Expansion
import numpy as np

FORMAT = 'gravity_comp_ros model'
VERSION = 3
# Maximum size of a model file; ten joints with every feature take 2 MB.
_MAX_BYTES = 64 * 2 ** 20


def save_model(path: Path | str, model: GravityModel) -> None:
    """
    Write a model file; an existing one is replaced atomically.

    :raises ModelFileError: if it cannot be written, or contains values without JSON form: a number
        that is not finite, an object in the provenance.
    """
    try:
        body = _to_json(model)
    except (TypeError, ValueError) as problem:
        raise ModelFileError(f'cannot write model {path}: {problem}') from problem
    document = {'format': FORMAT, 'version': VERSION, 'sha256': _checksum(body), 'model': body}
    text = json.dumps(document, indent=1, allow_nan=False) + '\n'
    write_atomically(Path(path), text.encode(), ModelFileError)


def checksum(model: GravityModel) -> str:
    """
    Return the SHA-256 that the file of this model has.

    :raises ModelFileError: if it has no form in JSON.
    """
    try:
        return _checksum(_to_json(model))
    except (TypeError, ValueError) as problem:
        raise ModelFileError(f'this model has no file: {problem}') from problem


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
        return _from_json(body)
    except ModelFileError as problem:
        raise ModelFileError(f'{path}: {problem}') from problem
    except (GravityCompError, AttributeError, KeyError, IndexError, TypeError, ValueError,
            OverflowError) as problem:
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


def _to_json(model: GravityModel) -> dict[str, Any]:
    """Return the model as lists for JSON; torques are omitted if there is an energy."""
    body: dict[str, Any] = {
        'joints': list(model.joints),
        'formulation': model.formulation,
        'noise': model.noise.tolist(),
        'coverage': {'q_min': model.coverage.q_min.tolist(),
                     'q_max': model.coverage.q_max.tolist(),
                     'n_samples': model.coverage.n_samples,
                     'n_runs': model.coverage.n_runs},
        'provenance': dict(model.provenance),
    }
    if model.energy is not None:
        body['energy'] = _terms(model.energy)
    else:
        body['torques'] = [_terms(torque) for torque in model.torques]
    if model.chain is not None:
        body['chain'] = {'axes': model.chain.axes.tolist(),
                         'moments': model.chain.moments.tolist()}
    if model.covariance is not None:
        body['covariance'] = model.covariance.tolist()
    if model.fitted.effects:
        body['fitted'] = [asdict(effect) for effect in model.fitted.effects]
    if model.residual_std is not None:
        body['residual_std'] = model.residual_std.tolist()
    if model.payload_path is not None:
        body['payload_path'] = _terms(model.payload_path)
    if model.geometry is not None:
        body['geometry'] = model.geometry.to_json()
    if model.applied.effects or model.history:
        body['applied'] = _applied_json(model)
    # Through JSON and back, so that the checksum is that of the parsed file.
    return dict(json.loads(json.dumps(body, allow_nan=False)))


def _terms(expansion: Expansion) -> dict[str, list]:
    return {'features': expansion.indices.tolist(), 'weights': expansion.weights.tolist()}


def _applied_json(model: GravityModel) -> dict[str, Any]:
    return {'effects': [asdict(effect) for effect in model.applied.effects],
            'history': [{**vars(step), 'previous': step.previous and _to_json(step.previous)}
                        for step in model.history]}


def _from_json(body: dict[str, Any]) -> GravityModel:
    model = _gravity(body)
    if 'fitted' in body:
        model = replace(model, fitted=Applied(tuple(map(_effect, body['fitted']))))
    if 'residual_std' in body:
        model = replace(model, residual_std=_floats(body['residual_std']))
    if 'payload_path' in body:
        model = replace(model, payload_path=_expansion(body['payload_path']))
    if 'geometry' in body:
        model = replace(model, geometry=Geometry.from_json(body['geometry']))
    if 'applied' not in body:
        return model
    parts = body['applied']
    applied = Applied(tuple(_effect(effect) for effect in parts['effects']))
    return replace(model, applied=applied,
                   history=tuple(_step(step) for step in parts['history']))


def _effect(parts: dict[str, Any]) -> AppliedEffect:
    return AppliedEffect(
        _text(parts['name']), None if parts['joint'] is None else _text(parts['joint']),
        _numbers(parts['setting']),
        {symbol: Value(float(x['value']), _text(x['unit']),
                       (float(x['ci95'][0]), float(x['ci95'][1])))
         for symbol, x in parts['coefficients'].items()})


def _step(parts: dict[str, Any]) -> Step:
    previous = parts['previous']
    return Step(parts['action'], tuple(_list(parts['effects'], str)), _text(parts['when']),
                _numbers(parts['before']), _numbers(parts['after']),
                None if previous is None else _from_json(previous))


def _numbers(values: dict[str, float]) -> dict[str, float]:
    return dict(zip(values, _floats(list(values.values())).tolist()))


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError('a name is not text')
    return value


def _gravity(body: dict[str, Any]) -> GravityModel:
    joints = tuple(_list(body['joints'], str))
    if body['formulation'] not in FORMULATIONS:
        raise ModelFileError(f'unknown formulation {body["formulation"]!r}; '
                             f'known: {", ".join(FORMULATIONS)}')
    place = body['coverage']
    coverage = Coverage(_floats(place['q_min']), _floats(place['q_max']),
                        int(place['n_samples']), int(place['n_runs']))
    noise = _floats(body['noise'])
    if not isinstance(body['provenance'], dict):
        raise TypeError('the provenance is not an object')
    if 'energy' in body:
        energy = _expansion(body['energy'])
        chain = _chain(body['chain']) if 'chain' in body else None
        return GravityModel.from_energy(joints, body['formulation'], energy, noise, coverage,
                                        body['provenance'], chain,
                                        _covariance(body))
    torques = tuple(_expansion(terms) for terms in body['torques'])
    return GravityModel(joints, body['formulation'], torques, None, noise, coverage,
                        body['provenance'])


def _expansion(terms: dict[str, list]) -> Expansion:
    return Expansion(np.array(_list(terms['features'], int), dtype=np.int64),
                     _floats(terms['weights']))


def _floats(values: object) -> FloatArray:
    return np.array(_list(values, (int, float)), dtype=np.float64)


def _list(values: object, kind: type | tuple[type, ...]) -> list[Any]:
    """Return a list of one kind of value; NumPy would silently convert others."""
    if not isinstance(values, list) or not all(isinstance(value, kind) for value in values):
        raise TypeError('a list contains a value of the wrong type')
    return values


def _chain(parts: dict[str, list]) -> Chain:
    return Chain(np.array(parts['axes'], dtype=np.float64),
                 np.array(parts['moments'], dtype=np.float64))


def _covariance(body: dict[str, Any]) -> FloatArray | None:
    if 'covariance' not in body:
        return None
    covariance = np.array(body['covariance'], dtype=np.float64)
    # A model without terms: JSON does not store the shape of an empty array.
    return covariance if covariance.size else covariance.reshape(0, 0)
