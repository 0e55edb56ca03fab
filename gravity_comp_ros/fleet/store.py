"""Samples that were read, kept beside the results, so that an interrupted run can go on."""

from __future__ import annotations

from dataclasses import asdict
import io
import json
from pathlib import Path
from typing import Any
import zipfile

from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import BagError, GravityCompError
from gravity_comp_ros.recordings.bag import ReadReport
from gravity_comp_ros.recordings.gated_bag import GatedRecording
import numpy as np

_ARRAYS = ('t', 'q', 'qd', 'tau')


class Store:
    """
    A folder of results, each known by the fingerprint of what it was made from.

    Files are written as a whole or not at all; one that is damaged counts as not there.

    :raises BagError: if the folder cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BagError(f'cannot make the folder {folder}: {error.strerror}') from None

    def recording(self, key: str) -> GatedRecording | None:
        """Return what was read before, None if there is nothing."""
        try:
            with np.load(self._folder / f'{key}.npz', allow_pickle=False) as file:
                head = json.loads(str(file['head']))
                arrays = {name: file[name] for name in _ARRAYS}
            report = ReadReport(**{**head['report'], 'path': Path(head['report']['path']),
                                   'notes': tuple(head['report']['notes'])})
            samples = JointSamples.single_run(head['names'], **arrays, label=head['label'])
        except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile, EOFError,
                GravityCompError):
            return None
        return GatedRecording(samples, report, head['dropped'])

    def keep(self, key: str, found: GatedRecording) -> None:
        """Keep what was read."""
        report = {**asdict(found.report), 'path': str(found.report.path)}
        head = json.dumps({'report': report, 'dropped': found.dropped,
                           'names': found.samples.names, 'label': found.samples.run_labels[0]})
        data = io.BytesIO()
        np.savez(data, head=np.array(head), **{name: getattr(found.samples, name)
                                               for name in _ARRAYS})
        write_atomically(self._folder / f'{key}.npz', data.getvalue(), BagError)

    def note(self, key: str) -> dict[str, Any] | None:
        """Return a result that is a JSON object, None if there is nothing."""
        try:
            found = json.loads((self._folder / f'{key}.json').read_text(encoding='utf-8'))
        except (OSError, ValueError):
            return None
        return found if isinstance(found, dict) else None

    def keep_note(self, key: str, value: dict[str, Any]) -> None:
        """Keep a JSON object."""
        write_atomically(self._folder / f'{key}.json', json.dumps(value).encode(), BagError)
