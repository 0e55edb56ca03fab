"""
State of a session: settings, stages of the model with the commands that reproduce them, its file.

Each session is one JSON file in the user's state folder (`$XDG_STATE_HOME/gravity_comp/workbench`,
default `~/.local/state`), readable only by this user and updated after every change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
import json
import os
from pathlib import Path
import re
import shlex
import shutil
from typing import Any

from gravity_comp_ros.api.axes import ArmOptions, NO_DESCRIPTION, WITH_AXES
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import DataError, GravityCompError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.models.codec import decode, encode
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.history import now
from gravity_comp_ros.models.model_file import load_model, model_to_json
from gravity_comp_ros.recordings.bag import ReadOptions, ReadReport
from gravity_comp_ros.recordings.read_options import option_words

# Model file in the exported command lines.
MODEL_FILE = 'arm.json'


@dataclass(frozen=True)
class Choice:
    """
    Chosen runs (by number) and joints, options of reading, and samples.

    The joints are those of `joints`, in this order. `urdf` is the robot description, None for that
    of the recordings; it gives the axes of a fit if `known_axes`. The model is fitted to and
    compared on the slow samples of the `gate`, all if it is None.
    """

    runs: tuple[int, ...] = ()
    joints: tuple[str, ...] = ()
    formulation: str = FitOptions().formulation
    reading: ReadOptions = ReadOptions()
    gate: GateOptions | None = GateOptions()
    urdf: Path | None = None
    known_axes: bool = True

    @property
    def description(self) -> Path | str | None:
        """Return the description of the axes, in the notation of --urdf."""
        return self.urdf if self.known_axes else NO_DESCRIPTION

    def options(self) -> ReadOptions:
        """Return the options to read the recordings; what is refused is refused by each job."""
        return replace(self.reading, joints=self.joints or None, refuse=False)

    def learning(self, ordered: bool) -> ArmOptions:
        """
        Return the options of the fit.

        :param ordered: whether the joints are given in the order of the arm.
        """
        urdf = self.description if self.formulation in WITH_AXES else None
        return ArmOptions(self.formulation, urdf, ordered=ordered)

    def recording(self, samples: JointSamples, reports: Sequence[ReadReport]) -> Recording:
        """
        Return the chosen runs and joints of all recordings.

        :raises DataError: if no run is chosen.
        """
        runs = [samples.run(number) for number in self.runs]
        if not runs:
            raise DataError('no run is selected')
        return Recording(concatenate(runs).joints(self.joints), self.gate,
                         tuple(reports[number] for number in self.runs))

    def command(self, verb: str, paths: tuple[Path, ...], joints: bool = False,
                gated: bool = True, **options: object) -> str:
        """
        Return a command line for the chosen ones of all recordings, with their reading.

        :param gated: whether the verb has a gate; further options are by name.
        """
        gate = {'all_samples': self.gate is None, 'max_speed': self.gate and self.gate.max_speed,
                'rate': self.gate and self.gate.rate_hz} if gated else {}
        # Absolute paths, so that the command lines run in any folder.
        files = [str(paths[run].resolve()) for run in self.runs]
        return f'gravity_comp {verb} ' + shlex.join(
            [*files, *option_words({**options, **gate}), *self.options().words(joints=joints)])

    def add_command(self, effects: tuple[str, ...], paths: tuple[Path, ...],
                    model: Path | str = MODEL_FILE) -> str:
        """Return the command line that adds effects to a model file."""
        return self.command(f'add {shlex.quote(",".join(effects))}', paths, model=model)


@dataclass(frozen=True)
class Stage:
    """
    One state of the model.

    A stage is a fit, or a model read from the file `given`, or the stage before it with added
    `effects`. `choice` has the settings of that step. `warnings` are about the model.
    `diagnosis` was made with the settings `diagnosed_with`.
    """

    name: str
    model: GravityModel
    choice: Choice = Choice()
    effects: tuple[str, ...] = ()
    given: Path | None = None
    diagnosis: Diagnosis | None = None
    diagnosed_with: Choice | None = None
    warnings: tuple[str, ...] = ()

    @classmethod
    def of_file(cls, path: Path) -> Stage:
        """
        Return the model of a file.

        :raises ModelFileError: if it cannot be read.
        """
        return cls(path.name, load_model(path), given=path)

    def command(self, paths: tuple[Path, ...]) -> str:
        """Return the command line of this step, for all recordings of the session."""
        if self.given is not None:
            return shlex.join(['cp', str(self.given.resolve()), MODEL_FILE])
        if self.effects:
            return self.choice.add_command(self.effects, paths)
        choice = self.choice
        return choice.command(
            'fit', paths, joints=True, output=MODEL_FILE, formulation=choice.formulation,
            urdf=choice.learning(True).urdf)


@dataclass(eq=False)
class State:
    """
    What is saved of a session. A new one has the arguments of the command alone.

    `given` are model files named on the command line. `joints` are all that can be chosen.
    `stages` are in the order of their creation, and `at` is the number of the current one.
    `to_learn` tells whether a fit was requested. `hashes` are the SHA-256 of the recordings by
    path, when they were read.
    """

    paths: tuple[Path, ...]
    choice: Choice = Choice()
    given: tuple[Stage, ...] = ()
    joints: tuple[str, ...] = ()
    stages: tuple[Stage, ...] = ()
    at: int | None = None
    to_learn: bool = True
    hashes: Mapping[str, str] = field(default_factory=dict)

    def commands(self) -> list[str]:
        """Return command lines that reproduce the current model exactly, and its evaluation."""
        if self.at is None:
            return []
        # From the last fit or file up to the current stage.
        start = max(k for k in range(self.at + 1) if not self.stages[k].effects)
        choice, model = self.choice, MODEL_FILE
        return [*(stage.command(self.paths) for stage in self.stages[start:self.at + 1]),
                choice.command('compare', self.paths, model=model),
                choice.command('diagnose', self.paths, gated=False, model=model,
                               html='report.html')]


_VERSION = 5
_ID = re.compile(r'[0-9a-f]{16}')
_MAX_SESSIONS = 50


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


def save(place: Path, identity: str, state: State) -> None:
    """
    Write a session, atomically.

    :raises GravityCompError: if it cannot be written.
    """
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as problem:
        raise GravityCompError(f'cannot save the session in {place}: {problem}') from problem
    document = {'version': _VERSION, 'changed': now(), **encode(state)}
    for name in ('stages', 'given'):
        for stage, saved in zip(getattr(state, name), document[name]):
            # A diagnosis is made again.
            saved |= {'model': model_to_json(stage.model), 'diagnosis': None,
                      'diagnosed_with': None}
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
        state: State = decode(State, {name: value for name, value in document.items()
                                      if name not in ('version', 'changed')})
        _check(state)
    except (TypeError, ValueError, OverflowError) as problem:
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
                tuple(Path(recording).name for recording in document['paths']),
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
        document = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise DataError(f'there is no session {path.stem}') from None
    except (OSError, ValueError, RecursionError) as problem:
        raise DataError(f'the file of session {path.stem} cannot be read: {problem}') from problem
    if not isinstance(document, dict) or document.get('version') != _VERSION:
        raise DataError(f'session {path.stem} was saved by another version of this program')
    return document


def _check(state: State) -> None:
    if not state.stages or state.stages[0].effects:
        raise ValueError('the first stage is neither a fit nor a file')
    runs = [run for choice in (state.choice, *(s.choice for s in state.stages))
            for run in choice.runs]
    if any(not 0 <= run < len(state.paths) for run in runs):
        raise ValueError('a run has no recording')
    if state.at is not None and not 0 <= state.at < len(state.stages):
        raise ValueError('there is no such stage')
