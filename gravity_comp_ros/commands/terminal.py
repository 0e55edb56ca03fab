"""
Terminal output of the commands: tables and notes on standard output, progress on standard error.

Text that may come from a file is passed through `safe`, which escapes rich markup and terminal
control sequences.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
import json
import math
import os
from pathlib import Path
import sys
import threading
from typing import Any

from gravity_comp_ros.commands.screen_table import ScreenTable, wrapped
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.printable import printable
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
from rich.progress import TimeElapsedColumn
from rich.text import Text

ProgressCallback = Callable[[str, float], None]

# Version of the JSON documents of the verbs (docs/json.md).
SCHEMA = 1
_WIDTH_WITHOUT_SCREEN = 110
# Delay before progress lines are printed to a log, in s.
_PROGRESS_DELAY = 2.0


def safe(text: object) -> str:
    """Return `text` as rich markup that shows it literally, on one line."""
    literal = escape(printable(text))
    # A trailing backslash would escape the markup that follows.
    return literal + ' ' if literal.endswith('\\') else literal


def console(stderr: bool = False) -> Console:
    """Return a console on the current standard output (or error); 110 columns off-screen."""
    out = Console(stderr=stderr, highlight=False, emoji=False)
    if not _has_width(out):
        out.width = _WIDTH_WITHOUT_SCREEN
    return out


def _has_width(out: Console) -> bool:
    """Return whether there is a screen, or COLUMNS sets the line width."""
    return out.is_terminal or 'COLUMNS' in os.environ


def show(*things: Any) -> None:
    """
    Print tables or lines of markup on standard output; escape file text with `safe`.

    On a screen, long lines are broken between words. Elsewhere they are not broken.
    """
    out = console()
    for thing in things:
        if not isinstance(thing, str):
            if isinstance(thing, ScreenTable) and not _has_width(out):
                # Programs that parse a table expect one row per line.
                out.width = max(out.width, thing.natural_width())
            out.print(thing)
            continue
        line = Text.from_markup(thing)
        for part in wrapped(line, out.width) if _has_width(out) else [line]:
            out.print(part, soft_wrap=True)


def say(*lines: str) -> None:
    """Print plain lines without markup on standard output."""
    show(*map(safe, lines))


def show_command(command: str) -> None:
    """Print a command to copy, on one unbroken line without markup."""
    console().print(Text(f'  {printable(command)}'), soft_wrap=True)


def note(text: str) -> None:
    """Print one plain line without markup on standard error."""
    print(printable(text), file=sys.stderr, flush=True)


def warn(*lines: str) -> None:
    """Print warnings without markup on standard error."""
    for line in lines:
        console(stderr=True).print(f'[yellow]warning:[/yellow] {safe(line)}', soft_wrap=True)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]] = (),
          left: Sequence[str] = (), folds: Sequence[str] | None = None,
          keys: int = 1) -> ScreenTable:
    """
    Return a `ScreenTable`; cells other than `Text` are shown as plain printable text.

    :param left: text columns in addition to the first; the others are numbers.
    :param folds: columns whose text may be broken into lines; default: those in `left`.
    :param keys: number of leading columns that identify a row.
    """
    cells = [[cell if isinstance(cell, Text) else Text(printable(cell)) for cell in row]
             for row in rows]
    return ScreenTable(title, columns, cells, left, left if folds is None else folds, keys)


@contextmanager
def progress() -> Iterator[ProgressCallback]:
    """
    Yield `report(stage, fraction)`, which shows progress on standard error.

    On a screen it is a bar. Elsewhere (a log) it is a line for each stage, after the first
    `_PROGRESS_DELAY` seconds.
    """
    err = console(stderr=True)
    if err.is_terminal:
        with Progress(TextColumn('{task.description}'), BarColumn(), TaskProgressColumn(),
                      TimeElapsedColumn(), console=err, transient=True) as bar:
            task = bar.add_task('', total=1.0)

            def report(stage: str, fraction: float) -> None:
                bar.update(task, description=safe(stage), completed=min(max(fraction, 0.0), 1.0))
            yield report
    else:
        lines = _StageLines(_PROGRESS_DELAY)
        try:
            yield lines
        finally:
            lines.close()


class _StageLines:
    """Progress for a log: the current stage after `delay` seconds, then each new stage."""

    def __init__(self, delay: float) -> None:
        self._stage: str | None = None
        self._shown: str | None = None
        self._silent = True
        self._lock = threading.Lock()
        # A timer, because a long stage may not report again.
        self._timer = threading.Timer(delay, self._end_silence)
        self._timer.daemon = True
        self._timer.start()

    def __call__(self, stage: str, fraction: float) -> None:
        with self._lock:
            self._stage = stage
            self._show()

    def close(self) -> None:
        """End the output."""
        self._timer.cancel()
        with self._lock:
            self._stage = None

    def _end_silence(self) -> None:
        with self._lock:
            self._silent = False
            self._show()

    def _show(self) -> None:
        if not self._silent and self._stage != self._shown and self._stage is not None:
            self._shown = self._stage
            note(f'... {self._stage}')


def emit_json(value: Mapping[str, Any], target: str) -> None:
    """
    Write `value` as JSON to the file `target` (atomically), or to standard output.

    NaN and infinity become null. The first key is `schema`, the version of the document
    (docs/json.md); it increases when a key is removed or changes its meaning.

    :param target: a path, or '-' for standard output.
    """
    document = {'schema': SCHEMA, **value}
    text = json.dumps(_plain(document), indent=2, ensure_ascii=target == '-', allow_nan=False)
    if target == '-':
        print(text, flush=True)
        return
    from gravity_comp_ros.atomic import write_atomically
    write_atomically(Path(target), (text + '\n').encode(), error=GravityCompError)


def _plain(value: Any) -> Any:
    """Return `value` in JSON types, with NumPy scalars and arrays converted."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(item) for item in value]
    if hasattr(value, 'tolist'):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return str(value)
