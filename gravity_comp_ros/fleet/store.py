"""Cache of samples and results of a fleet run, from which an interrupted run is resumed."""

from __future__ import annotations

from dataclasses import asdict, replace
import io
import json
from pathlib import Path
from typing import Any
import zipfile

from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import BagError, GravityCompError
from gravity_comp_ros.facts.fact import Fact
from gravity_comp_ros.recordings.bag import ReadReport
from gravity_comp_ros.recordings.gated_bag import GatedRecording
import numpy as np

_ARRAYS = ('t', 'q', 'qd', 'tau')


class Store:
    """
    Cache folder; the key of an entry is the fingerprint of its inputs.

    Files are written atomically. A damaged file counts as missing.

    :raises BagError: if the folder cannot be created.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BagError(f'cannot create the folder {folder}: {error.strerror}') from None

    def load_recording(self, key: str) -> GatedRecording | None:
        """Return cached samples, None if there are none."""
        try:
            with np.load(self._folder / f'{key}.npz', allow_pickle=False) as file:
                head = json.loads(str(file['head']))
                arrays = {name: file[name] for name in _ARRAYS}
                qdd = file['qdd']
            report = ReadReport(**{**head['report'], 'path': Path(head['report']['path']),
                                   'file_notes': tuple(head['report']['file_notes']),
                                   'facts': tuple(map(Fact.from_json, head['facts']))})
            samples = JointSamples.single_run(head['names'], **arrays, label=head['label'],
                                              qdd=qdd if len(qdd) else None)
        except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile, EOFError,
                GravityCompError):
            return None
        return GatedRecording(samples, report, head['dropped'])

    def save_recording(self, key: str, recording: GatedRecording) -> None:
        """Store samples."""
        samples, report = recording.samples, recording.report
        plain = asdict(replace(report, facts=()))
        head = json.dumps({'report': {**plain, 'path': str(report.path)},
                           'facts': [fact.to_json() for fact in report.facts],
                           'dropped': recording.dropped, 'names': samples.names,
                           'label': samples.run_labels[0]})
        data = io.BytesIO()
        qdd = np.zeros((0, samples.n_joints)) if samples.qdd is None else samples.qdd
        np.savez(data, head=np.array(head), qdd=qdd,
                 **{name: getattr(samples, name) for name in _ARRAYS})
        write_atomically(self._folder / f'{key}.npz', data.getvalue(), BagError)

    def load_result(self, key: str) -> dict[str, Any] | None:
        """Return a stored JSON object, None if there is none."""
        try:
            result = json.loads((self._folder / f'{key}.json').read_text(encoding='utf-8'))
        except (OSError, ValueError):
            return None
        return result if isinstance(result, dict) else None

    def save_result(self, key: str, value: dict[str, Any]) -> None:
        """Store a JSON object."""
        write_atomically(self._folder / f'{key}.json', json.dumps(value).encode(), BagError)
