"""
What the commands show: tables and notes on standard output, progress on standard error.

Text that may come from a file goes through `safe`, so that neither rich's markup nor the
terminal's own escapes in it are obeyed.
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

# Of the JSON that the verbs print (docs/json.md).
SCHEMA = 1
_WIDTH_WITHOUT_SCREEN = 110
# Work is long from here on, in seconds.
_LONG = 2.0


def safe(text: object) -> str:
    """Return `text` as rich markup that shows it literally, on one line."""
    shown = escape(printable(text))
    # A trailing backslash would escape the markup that follows.
    return shown + ' ' if shown.endswith('\\') else shown


def console(stderr: bool = False) -> Console:
    """Return a console on today's standard output (or error), wide enough off-screen."""
    made = Console(stderr=stderr, highlight=False, emoji=False)
    if not _has_width(made):
        made = Console(stderr=stderr, highlight=False, emoji=False,
                       width=_WIDTH_WITHOUT_SCREEN)
    return made


def _has_width(out: Console) -> bool:
    """Return whether there is a screen, or the user says how wide a line may be."""
    return out.is_terminal or 'COLUMNS' in os.environ


def show(*things: Any) -> None:
    """
    Print tables or lines of markup on standard output; escape file text with `safe`.

    On a screen, long lines are broken between words. Elsewhere they stay lines.
    """
    out = console()
    for thing in things:
        if not isinstance(thing, str):
            if isinstance(thing, ScreenTable) and not _has_width(out):
                # A program that reads a table wants one row on one line.
                out.width = max(out.width, thing.natural_width())
            out.print(thing)
            continue
        line = Text.from_markup(thing)
        for part in wrapped(line, out.width) if _has_width(out) else [line]:
            out.print(part, soft_wrap=True)


def say(*lines: str) -> None:
    """Print plain lines on standard output; nothing in them is markup."""
    show(*map(safe, lines))


def show_command(command: str) -> None:
    """Print a command to be copied: unbroken, whatever the width; nothing in it is markup."""
    console().print(Text(f'  {printable(command)}'), soft_wrap=True)


def note(text: str) -> None:
    """Print one plain line on standard error; nothing in it is markup."""
    print(printable(text), file=sys.stderr, flush=True)


def warn(*lines: str) -> None:
    """Print warnings on standard error; nothing in them is markup."""
    for line in lines:
        console(stderr=True).print(f'[yellow]warning:[/yellow] {safe(line)}', soft_wrap=True)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]] = (),
          left: Sequence[str] = (), folds: Sequence[str] | None = None,
          keys: int = 1) -> ScreenTable:
    """
    Return a table that fits on any screen; see `ScreenTable`.

    Every cell is shown as it is, in printable characters, unless it is a `Text`.

    :param left: columns of text beside the first; the rest are numbers.
    :param folds: columns whose text may go on further lines; those in `left` if not given.
    :param keys: how many columns say what a row is about.
    """
    shown = [[cell if isinstance(cell, Text) else Text(printable(cell)) for cell in row]
             for row in rows]
    return ScreenTable(title, columns, shown, left, left if folds is None else folds, keys)


@contextmanager
def progress() -> Iterator[ProgressCallback]:
    """
    Yield `report(stage, fraction)`, which shows progress on standard error.

    On a screen it is a bar. Elsewhere (a log) it is a line for each stage, once the work has
    taken `_LONG` seconds: what is done or fails at once needs no progress.
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
        lines = _StageLines(_LONG)
        try:
            yield lines
        finally:
            lines.close()


class _StageLines:
    """Progress for a log: after `patience` seconds the stage of now, then each new one."""

    def __init__(self, patience: float) -> None:
        self._stage: str | None = None
        self._shown: str | None = None
        self._patient = True
        self._lock = threading.Lock()
        # A stage may last long without a word, so waiting for its next report is not enough.
        self._timer = threading.Timer(patience, self._lose_patience)
        self._timer.daemon = True
        self._timer.start()

    def __call__(self, stage: str, fraction: float) -> None:
        with self._lock:
            self._stage = stage
            self._show()

    def close(self) -> None:
        """Show nothing more."""
        self._timer.cancel()
        with self._lock:
            self._stage = None

    def _lose_patience(self) -> None:
        with self._lock:
            self._patient = False
            self._show()

    def _show(self) -> None:
        if not self._patient and self._stage != self._shown and self._stage is not None:
            self._shown = self._stage
            note(f'... {self._stage}')


def emit_json(value: Mapping[str, Any], target: str) -> None:
    """
    Write `value` as JSON to the file `target` (old or new, never half), or to standard output.

    Numbers that JSON cannot say (NaN, infinity) become null. `schema` comes first: docs/json.md
    describes its keys, and it counts up whenever one is removed or changes its meaning.

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
    """Return `value` in JSON's own types; NumPy's scalars and arrays are unpacked."""
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
