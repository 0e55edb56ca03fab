"""Results of single recordings, stored in a folder so that a campaign can resume."""

from __future__ import annotations

from dataclasses import dataclass
import hashlib
import json
from pathlib import Path
from typing import Any

from bench.cases.cases import Case
import gravity_comp_ros
from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.errors import GravityCompError

_ROOT = Path(gravity_comp_ros.__file__).parent
_ROOMS = ('diagnosis', 'effects', 'evaluation', 'estimation', 'models', 'simulation')


@dataclass(frozen=True)
class Task:
    """One recording to diagnose."""

    case: Case
    seed: int
    rate: float

    @property
    def file(self) -> str:
        return f'{self.case.arm}.{self.case.name}.{self.seed}.json'


def fingerprint() -> str:
    """Return a hash of the code that simulates and diagnoses recordings."""
    digest = hashlib.sha256()
    for room in _ROOMS:
        for path in sorted((_ROOT / room).rglob('*.py')):
            digest.update(path.relative_to(_ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def load(folder: Path, task: Task, code: str | None) -> dict[str, Any] | None:
    """Return the stored result of a task, of the same code unless `code` is None; else None."""
    path = folder / task.file
    try:
        result: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError):
        return None
    if result.get('rate') != task.rate or (code is not None and result.get('code') != code):
        return None
    return result


def save(folder: Path, task: Task, result: dict[str, Any]) -> None:
    text = json.dumps(result, indent=1, ensure_ascii=False)
    write_atomically(folder / task.file, text.encode(), GravityCompError)
