"""Results of single cases in the files of a folder, so that a stopped run resumes; tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import hashlib
import json
from multiprocessing import get_context
import os
from pathlib import Path
from time import monotonic
from typing import Any, TypeVar

import gravity_comp_ros
from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.errors import GravityCompError

_PACKAGE = Path(gravity_comp_ros.__file__).parent
# Rooms of the code that simulates, fits and diagnoses.
_ROOMS = ('api', 'data', 'diagnosis', 'effects', 'estimation', 'evaluation', 'models',
          'regression', 'simulation')
Task = TypeVar('Task')
Result = dict[str, Any]


def table(head: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a Markdown table from the titles of its columns and the cells of its rows."""
    first, *others = map(row_of, (head, *rows))
    return '\n'.join([first, f'|{"---|" * len(head)}', *others])


def row_of(cells: Iterable[object]) -> str:
    """Return a row of a Markdown table."""
    return f'| {" | ".join(map(str, cells))} |'


def fingerprint(*more: Path) -> str:
    """Return a hash of the code of the package, and of further folders."""
    digest = hashlib.sha256()
    for folder in (*(_PACKAGE / room for room in _ROOMS), *more):
        for path in sorted(folder.rglob('*.py')):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def load(path: Path, code: str | None = None) -> Result:
    """Return a stored result, of this code if one is given; empty if there is none."""
    try:
        result = dict(json.loads(path.read_text(encoding='utf-8')))
    except (OSError, ValueError):
        return {}
    return result if code in (None, result.get('code')) else {}


def run(work: Callable[[Task], tuple[Task, Result]], tasks: Sequence[Task],
        file_of: Callable[[Task], Path], code: str, jobs: int,
        said: Callable[[Result], str]) -> None:
    """Do tasks in parallel processes; store the result of each, and print what is said of it."""
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    start = monotonic()
    with get_context('spawn').Pool(jobs, maxtasksperchild=4) as pool:
        results: Iterable[tuple[Task, Result]] = pool.imap_unordered(work, tasks)
        for count, (task, result) in enumerate(results, start=1):
            text = json.dumps({**result, 'code': code}, indent=1, ensure_ascii=False)
            write_atomically(file_of(task), text.encode(), GravityCompError)
            print(f'{count}/{len(tasks)} {monotonic() - start:.0f} s: {said(result)}', flush=True)
