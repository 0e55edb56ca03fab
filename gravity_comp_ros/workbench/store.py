"""
Saved sessions: recordings by path and hash, settings, stages and models.

Each session is one JSON file in the user's state folder (`$XDG_STATE_HOME/gravity_comp/workbench`,
default `~/.local/state`), readable only by this user and updated after every change.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
import json
import os
from pathlib import Path
import re
import shutil
import tempfile
from typing import Any

from gravity_comp_ros.api.provenance import now
from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.errors import DataError, GravityCompError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.workbench.stages import Choice, Stage, State

_VERSION = 3
_ID = re.compile(r'[0-9a-f]{16}')
_MAX_SESSIONS = 50
_MAX_BYTES = 256 * 2 ** 20


@dataclass(frozen=True)
class Entry:
    """Entry of the list of earlier sessions."""

    id: str
    changed: str
    recordings: tuple[str, ...]
    stages: tuple[str, ...]


def folder() -> Path:
    """Return the folder of saved sessions."""
    base = os.environ.get('XDG_STATE_HOME') or str(Path.home() / '.local' / 'state')
    return Path(base) / 'gravity_comp' / 'workbench'


def model_text(model: GravityModel) -> str:
    """
    Return the content of a model file.

    :raises ModelFileError: if it cannot be stored.
    """
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / 'model.json'
        save_model(path, model)
        return path.read_text()


def save(place: Path, identity: str, state: State) -> None:
    """
    Write a session, atomically.

    :raises GravityCompError: if it cannot be written.
    """
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as problem:
        raise GravityCompError(f'cannot save the session in {place}: {problem}') from problem
    document = {
        'version': _VERSION, 'changed': now(), 'urdf': _absolute(state.urdf),
        'recordings': [_absolute(path) for path in state.paths], 'hashes': dict(state.hashes),
        'given': [_absolute(stage.given) for stage in state.given], 'joints': list(state.joints),
        'choice': asdict(state.choice), 'at': state.at, 'to_learn': state.to_learn,
        'stages': [_stage(stage) for stage in state.stages]}
    path = place / f'{identity}.json'
    write_atomically(path, json.dumps(document).encode(), GravityCompError)
    path.chmod(0o600)
    for old in _newest_first(place)[_MAX_SESSIONS:]:
        old.unlink(missing_ok=True)
        shutil.rmtree(place / 'recordings' / old.stem, ignore_errors=True)


def load(place: Path, identity: str) -> State:
    """
    Return the state of a saved session.

    :raises GravityCompError: if there is none with this id, or its file is damaged.
    """
    if not _ID.fullmatch(identity):
        raise DataError('invalid session id')
    document = _read(place / f'{identity}.json')
    try:
        given = tuple(Stage.of_file(path) for path in map(Path, document['given'])
                      if path.is_file())
        state = State(
            tuple(map(Path, document['recordings'])), _choice(document['choice']), given,
            Path(document['urdf']) if document['urdf'] else None, tuple(document['joints']),
            tuple(_unstage(entry) for entry in document['stages']), document['at'],
            bool(document['to_learn']), dict(document['hashes']))
        _check(state)
    except (KeyError, TypeError, ValueError, AttributeError) as problem:
        raise DataError(f'the file of session {identity} is damaged: {problem}') from problem
    return state


def listed(place: Path, max_count: int = 10) -> list[Entry]:
    """Return the latest sessions, the newest first; unreadable files are omitted."""
    entries = []
    for path in _newest_first(place)[:max_count]:
        try:
            document = _read(path)
            entries.append(Entry(
                path.stem, str(document['changed']),
                tuple(Path(recording).name for recording in document['recordings']),
                tuple(str(stage['name']) for stage in document['stages'])))
        except (GravityCompError, KeyError, TypeError):
            continue
    return entries


def _newest_first(place: Path) -> list[Path]:
    try:
        files = [path for path in place.glob('*.json') if _ID.fullmatch(path.stem)]
        return sorted(files, key=lambda path: path.stat().st_mtime, reverse=True)
    except OSError:
        return []


def _read(path: Path) -> dict[str, Any]:
    try:
        with path.open('rb') as stream:
            data = stream.read(_MAX_BYTES + 1)
        document = json.loads(data)
    except FileNotFoundError:
        raise DataError(f'there is no session {path.stem}') from None
    except (OSError, ValueError, RecursionError) as problem:
        raise DataError(f'the file of session {path.stem} cannot be read: {problem}') from problem
    if not isinstance(document, dict) or document.get('version') != _VERSION:
        raise DataError(f'session {path.stem} was saved by another version of this program')
    return document


def _absolute(path: Path | None) -> str | None:
    return None if path is None else str(path.resolve())


def _stage(stage: Stage) -> dict[str, Any]:
    return {'name': stage.name, 'effects': list(stage.effects), 'given': _absolute(stage.given),
            'choice': asdict(stage.choice), 'warnings': list(stage.warnings),
            'model': model_text(stage.model)}


def _unstage(entry: dict[str, Any]) -> Stage:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / 'model.json'
        path.write_text(entry['model'])
        model = load_model(path)
    return Stage(str(entry['name']), model, _choice(entry['choice']),
                 tuple(map(str, entry['effects'])),
                 Path(entry['given']) if entry['given'] else None,
                 warnings=tuple(map(str, entry['warnings'])))


def _choice(entry: dict[str, Any]) -> Choice:
    options: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value
                               for name, value in entry['reading'].items()}
    return Choice(**{**entry, 'runs': tuple(map(int, entry['runs'])),
                     'joints': tuple(map(str, entry['joints'])),
                     'reading': ReadOptions(**options)})


def _check(state: State) -> None:
    if not state.stages or state.stages[0].effects:
        raise ValueError('the first stage is neither a fit nor a file')
    runs = [run for choice in (state.choice, *(s.choice for s in state.stages))
            for run in choice.runs]
    if any(not 0 <= run < len(state.paths) for run in runs):
        raise ValueError('a run has no recording')
    if state.at is not None and not 0 <= state.at < len(state.stages):
        raise ValueError('there is no such stage')
