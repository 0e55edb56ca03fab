"""
Saved sessions: recordings by path and hash, stages and models.

Each session is one JSON file in the user's state folder (`$XDG_STATE_HOME/gravity_comp/workbench`,
default `~/.local/state`), readable only by this user and updated after every change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
import json
import os
from pathlib import Path
import re
import shutil
import tempfile
from typing import Any

from gravity_comp_ros.api.axes import NO_DESCRIPTION
from gravity_comp_ros.api.provenance import now
from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.errors import DataError, GravityCompError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.workbench.choice import Choice
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.session_state import GivenModel
from gravity_comp_ros.workbench.stages import Stage

_VERSION = 1
_ID = re.compile(r'[0-9a-f]{16}')
_MAX_SESSIONS = 50
_MAX_BYTES = 256 * 2 ** 20


@dataclass(frozen=True)
class SavedSession:
    """Entry of the list of earlier sessions."""

    id: str
    changed: str
    recordings: tuple[str, ...]
    stages: tuple[str, ...]


def folder() -> Path:
    """Return the folder of saved sessions."""
    base = os.environ.get('XDG_STATE_HOME') or str(Path.home() / '.local' / 'state')
    return Path(base) / 'gravity_comp' / 'workbench'


def is_id(text: str) -> bool:
    """Return whether a text is a valid session id; only valid ids become file names."""
    return _ID.fullmatch(text) is not None


def model_text(model: GravityModel) -> str:
    """
    Return the content of a model file.

    :raises ModelFileError: if it cannot be stored.
    """
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / 'model.json'
        save_model(path, model)
        return path.read_text()


def save(place: Path, identity: str, session: Session) -> None:
    """
    Write a session, atomically.

    :raises GravityCompError: if it cannot be written.
    """
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as problem:
        raise GravityCompError(f'cannot save the session in {place}: {problem}') from problem
    read = session.read
    document = {
        'version': _VERSION, 'changed': now(), 'topic': session.topic,
        'urdf': None if session.urdf is None else str(session.urdf.resolve()),
        'recordings': [{'path': str(path.resolve()),
                        'sha256': read.reports[k].sha256 if read and k < len(read.reports)
                        else None}
                       for k, path in enumerate(session.paths)],
        'given': [str(given.path.resolve()) for given in session.given],
        'joints': list(session.joints), 'choice': asdict(session.choice), 'at': session.at,
        'to_learn': session.to_learn, 'stages': [_stage(stage) for stage in session.stages]}
    path = place / f'{identity}.json'
    write_atomically(path, json.dumps(document).encode(), GravityCompError)
    path.chmod(0o600)
    for old in _newest_first(place)[_MAX_SESSIONS:]:
        old.unlink(missing_ok=True)
        shutil.rmtree(place / 'recordings' / old.stem, ignore_errors=True)


def load(place: Path, identity: str) -> tuple[Session, dict[str, str]]:
    """
    Return a saved session, and the hashes of its recordings by path.

    :raises GravityCompError: if there is none with this id, or its file is damaged.
    """
    if not is_id(identity):
        raise DataError('invalid session id')
    document = _read(place / f'{identity}.json')
    try:
        given = tuple(GivenModel(Path(path), load_model(path)) for path in document['given']
                      if Path(path).is_file())
        paths = tuple(Path(entry['path']) for entry in document['recordings'])
        urdf = document.get('urdf')
        session = Session(paths, _choice(document['choice']), given, document['topic'],
                          None if urdf is None else Path(urdf))
        session.joints = tuple(document['joints'])
        session.stages = [_unstage(entry) for entry in document['stages']]
        session.at, session.to_learn = document['at'], bool(document['to_learn'])
        _check(session)
        hashes = {entry['path']: entry['sha256'] for entry in document['recordings']
                  if entry['sha256']}
    except (KeyError, TypeError, ValueError, AttributeError) as problem:
        raise DataError(f'the file of session {identity} is damaged: {problem}') from problem
    return session, hashes


def changed_recordings(session: Session, hashes: Mapping[str, str]) -> list[str]:
    """Return the names of recordings that changed since the session was saved."""
    if session.read is None:
        return []
    return [path.name for path, report in zip(session.paths, session.read.reports)
            if hashes.get(str(path.resolve()), report.sha256) != report.sha256]


def listed(place: Path, max_count: int = 10) -> list[SavedSession]:
    """Return the latest sessions, the newest first; unreadable files are omitted."""
    sessions = []
    for path in _newest_first(place)[:max_count]:
        try:
            document = _read(path)
            sessions.append(SavedSession(path.stem, str(document['changed']), tuple(
                Path(entry['path']).name for entry in document['recordings']),
                tuple(str(stage['name']) for stage in document['stages'])))
        except (GravityCompError, KeyError, TypeError):
            continue
    return sessions


def _newest_first(place: Path) -> list[Path]:
    try:
        files = [path for path in place.glob('*.json') if is_id(path.stem)]
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


def _stage(stage: Stage) -> dict[str, Any]:
    return {'name': stage.name, 'note': stage.note, 'parent': stage.parent,
            'effects': list(stage.effects), 'given': str(stage.given) if stage.given else None,
            'choice': asdict(stage.choice), 'held_out': dict(stage.held_out),
            'warnings': list(stage.warnings),
            'model': model_text(stage.model)}


def _unstage(entry: dict[str, Any]) -> Stage:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / 'model.json'
        path.write_text(entry['model'])
        model = load_model(path)
    held_out = {str(joint): float(x) for joint, x in entry['held_out'].items()}
    return Stage(str(entry['name']), model, _choice(entry['choice']), entry['parent'],
                 tuple(str(effect) for effect in entry['effects']),
                 Path(entry['given']) if entry['given'] else None, held_out,
                 note=str(entry['note']),
                 warnings=tuple(str(line) for line in entry.get('warnings', ())))


def _choice(entry: dict[str, Any]) -> Choice:
    # Sessions of earlier releases have no `urdf` and used no description.
    return Choice(**{'urdf': NO_DESCRIPTION, **entry,
                     'runs': tuple(int(run) for run in entry['runs']),
                     'joints': tuple(str(joint) for joint in entry['joints'])})


def _check(session: Session) -> None:
    for number, stage in enumerate(session.stages):
        if stage.parent is not None and not 0 <= stage.parent < number:
            raise ValueError('a stage comes before its parent')
    runs = [run for choice in (session.choice, *(s.choice for s in session.stages))
            for run in choice.runs]
    if any(not 0 <= run < len(session.paths) for run in runs):
        raise ValueError('a run has no recording')
    if session.at is not None and not 0 <= session.at < len(session.stages):
        raise ValueError('there is no such stage')
