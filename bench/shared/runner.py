"""Cases of a bench: their command line, their processes, a file for each result, and the table."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
import hashlib
import json
from multiprocessing import get_context
import os
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

import gravity_comp_ros
from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.errors import GravityCompError
import numpy as np

_PACKAGE = Path(gravity_comp_ros.__file__).parent
# Rooms of the code that simulates, fits and diagnoses.
_ROOMS = ('api', 'data', 'diagnosis', 'effects', 'estimation', 'evaluation', 'models',
          'regression', 'simulation')
Result = dict[str, Any]
Work = Callable[..., Result]


def run(doc: str, add: Callable[[ArgumentParser], object],
        cases: Callable[[Namespace], Mapping[str, tuple[Any, ...]]], work: Work,
        line: Callable[[Result], str], table: Callable[[list[Result]], str]) -> int:
    """
    Do the cases of a command line, print a line for each, and then the table.

    With a folder each result is kept there as JSON, with `table.md`, so that a stopped run
    resumes. Results of other code are computed again, unless --keep is given.

    :param doc: documentation of the bench; its first sentence is that of the command line.
    :param add: adds the options of the bench to the parser.
    :param cases: returns the arguments of `work` for each case, by its name.
    :param work: returns the result of a case; runs in another process.
    :param line: returns the text of one result.
    :param table: returns the text of all results, in the order of the cases.
    """
    parser = ArgumentParser(description=doc.strip().splitlines()[0])
    parser.add_argument('folder', nargs='?', type=Path, help='folder that keeps the results')
    parser.add_argument('--jobs', type=int, default=1, help='processes (default: %(default)s)')
    parser.add_argument('--keep', action='store_true', help='keep results of other code')
    add(parser)
    args = parser.parse_args()
    tasks, code = cases(args), _fingerprint(work)
    with TemporaryDirectory() if args.folder is None else nullcontext(args.folder) as name:
        folder = Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        stored = {name: _load(folder / f'{name}.json', None if args.keep else code)
                  for name in tasks}
        missing = [name for name in tasks if not stored[name]]
        print(f'{len(tasks)} cases, {len(tasks) - len(missing)} done before', flush=True)
        start = monotonic()
        with get_context('spawn').Pool(args.jobs, maxtasksperchild=4) as pool:
            done = pool.imap_unordered(partial(_one, work), [(n, tasks[n]) for n in missing])
            for count, (name, result) in enumerate(done, start=1):
                stored[name] = result
                text = json.dumps({**result, 'code': code}, indent=1, ensure_ascii=False)
                write_atomically(folder / f'{name}.json', text.encode(), GravityCompError)
                print(f'{count}/{len(missing)} {monotonic() - start:.0f} s: {name} {line(result)}',
                      flush=True)
        text = table(list(stored.values()))
        write_atomically(folder / 'table.md', f'{text}\n'.encode(), GravityCompError)
    print(text)
    return 0


def seeds(text: str) -> list[int]:
    """Return the seeds of a list such as 400 or 300-304,401."""
    out: list[int] = []
    for part in text.split(','):
        first, _, last = part.partition('-')
        out += range(int(first), int(last or first) + 1)
    return out


def names(text: str) -> list[str]:
    """Return the names of a list such as panda,ur5."""
    return text.split(',')


def figures(result: Result) -> str:
    """Return the figures of a result as a row of a table."""
    return row_of(f'{value:.3g}' for key, value in result.items() if key != 'code')


def extremes(results: Sequence[Result]) -> str:
    """Return the least, median and worst of each figure as a table."""
    titles = [key for key in results[0] if key != 'code']
    values = np.array([[result[title] for title in titles] for result in results])
    return table_of(('', *titles), (
        (word, *(f'{value:.3g}' for value in row)) for word, row in (
            ('least', values.min(axis=0)), ('median', np.median(values, axis=0)),
            ('worst', values.max(axis=0)))))


def table_of(head: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a Markdown table from the titles of its columns and the cells of its rows."""
    first, *others = map(row_of, (head, *rows))
    return '\n'.join([first, f'|{"---|" * len(head)}', *others])


def row_of(cells: Iterable[object]) -> str:
    """Return a row of a Markdown table."""
    return f'| {" | ".join(map(str, cells))} |'


def _one(work: Work, task: tuple[str, tuple[Any, ...]]) -> tuple[str, Result]:
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    name, arguments = task
    return name, work(*arguments)


def _fingerprint(work: Work) -> str:
    """Return a hash of the code of the package, and of the folder of a bench."""
    digest, bench = hashlib.sha256(), Path(str(sys.modules[work.__module__].__file__)).parent
    for folder in (*(_PACKAGE / room for room in _ROOMS), bench):
        for path in sorted(folder.rglob('*.py')):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _load(path: Path, code: str | None) -> Result:
    """Return a stored result, of this code if one is given; empty if there is none."""
    try:
        result = dict(json.loads(path.read_text(encoding='utf-8')))
    except (OSError, ValueError):
        return {}
    return result if code in (None, result.get('code')) else {}
