"""
Terminal output of the commands: tables and notes on standard output, progress on standard error.

Lines are plain text: markup of rich is not interpreted, and terminal control sequences, which a
file may contain, are escaped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
import json
import os
from pathlib import Path
import sys
import time
from typing import Any

from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.printable import printable
from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
from rich.progress import TimeElapsedColumn
from rich.table import Table
from rich.text import Text

ProgressCallback = Callable[[str, float], None]

# A part of the output of a verb.
Line = TextTable | Text | str
# Version of the JSON documents of the verbs (docs/json.md).
SCHEMA = 1
# Width of the output where there is no screen: a row of a table is one line.
_WIDTH_WITHOUT_SCREEN = 1000
# Delay before progress lines are printed to a log, in s.
_PROGRESS_DELAY = 2.0


def styled(style: str, start: str, rest: str = '') -> Text:
    """Return a line of plain text with a start in a style of rich."""
    return Text.assemble((_literal(start), style), _literal(rest))


def _literal(text: object) -> str:
    """Return printable text, with the spaces at its beginning."""
    line = str(text)
    return ' ' * (len(line) - len(line.lstrip(' '))) + printable(line)


def console(stderr: bool = False) -> Console:
    """Return a console on the current standard output (or error); its lines may be long."""
    out = Console(stderr=stderr, highlight=False, emoji=False)
    if not (out.is_terminal or 'COLUMNS' in os.environ):
        out.width = _WIDTH_WITHOUT_SCREEN
    return out


def show(*things: Line) -> None:
    """
    Print tables and lines of text on standard output.

    On a screen, lines are broken between words. Elsewhere a line of text, or a row of a table, is
    one line, as programs that parse the output expect.
    """
    out = console()
    for thing in things:
        if isinstance(thing, TextTable):
            # Names and numbers are never cut: on a narrow screen the lines are too long.
            table, free = _rich(thing), out.options.update(max_width=_WIDTH_WITHOUT_SCREEN)
            out.print(table, width=max(out.width, out.measure(table, options=free).minimum),
                      crop=False)
        else:
            line = thing if isinstance(thing, Text) else Text(_literal(thing))
            out.print(line, soft_wrap=bool(line.no_wrap) or out.width == _WIDTH_WITHOUT_SCREEN)


def command(line: str) -> Text:
    """Return a command to copy, which `show` prints on one unbroken line."""
    return Text(f'  {printable(line)}', no_wrap=True)


def section(title: str, lines: Sequence[str]) -> list[Line]:
    """Return a bold title after an empty line, with indented lines; nothing without lines."""
    return ['', styled('bold', title), *(f'  {line}' for line in lines)] if lines else []


def bullets(style: str, lines: Iterable[str]) -> list[Line]:
    """Return lines with a bullet in a style of rich."""
    return [styled(style, '  •', f' {line}') for line in lines]


def note(text: str) -> None:
    """Print one plain line without markup on standard error."""
    print(printable(text), file=sys.stderr, flush=True)


def warn(*lines: str) -> None:
    """Print warnings without markup on standard error."""
    for line in lines:
        console(stderr=True).print(styled('yellow', 'warning:', f' {line}'), soft_wrap=True)


def _rich(table: TextTable) -> Table:
    """Return a table whose headings and texts are broken between words where they must."""
    result = Table(title=Text(printable(table.title)) if table.title else None,
                   title_justify='left', title_style='bold', box=box.SIMPLE_HEAD, pad_edge=False)
    cells, numbers = table.cells(), table.has_numbers()
    for k, ((heading, *texts), is_number) in enumerate(zip(zip(*cells), numbers)):
        words = heading.split() + (texts if is_number or k == 0 else ' '.join(texts).split())
        result.add_column(Text(heading), min_width=max(map(cell_len, words)),
                          justify='right' if is_number else 'left')
    for row in cells[1:]:
        result.add_row(*map(Text, row))
    return result


@contextmanager
def progress() -> Iterator[ProgressCallback]:
    """
    Yield `report(stage, fraction)`, which shows progress on standard error.

    On a screen it is a bar. Elsewhere (a log) it is a line for each stage that is reported after
    `_PROGRESS_DELAY` seconds.
    """
    err = console(stderr=True)
    if err.is_terminal:
        with Progress(TextColumn('{task.description}', markup=False), BarColumn(),
                      TaskProgressColumn(), TimeElapsedColumn(), console=err,
                      transient=True) as bar:
            task = bar.add_task('', total=1.0)
            yield lambda stage, fraction: bar.update(
                task, description=printable(stage), completed=min(max(fraction, 0.0), 1.0))
        return
    begin, printed = time.monotonic(), ''

    def report(stage: str, fraction: float) -> None:
        nonlocal printed
        if stage != printed and time.monotonic() - begin >= _PROGRESS_DELAY:
            printed = stage
            note(f'... {stage}')

    yield report


@dataclass(frozen=True)
class Answer:
    """
    Result of a verb: the `document` of --json, the text in `lines`, `warnings`, exit `status`.

    NaN and infinity become null. The first key is `schema`, the version of the document
    (docs/json.md); it increases when a key is removed or changes its meaning. A file is written
    atomically.
    """

    document: Mapping[str, Any]
    lines: Sequence[Line]
    warnings: Sequence[str] = ()
    status: int = 0

    def give(self, json_file: str | None) -> int:
        """
        Print the result and return the exit status.

        :param json_file: file of the document, '-' to print it instead of the text, or None.
        """
        is_printed = json_file == '-'
        if not is_printed:
            show(*self.lines)
        warn(*self.warnings)
        if json_file:
            text = json.dumps({'schema': SCHEMA, **self.document}, default=_plain)
            finite = json.loads(text, parse_constant=lambda name: None)
            text = json.dumps(finite, indent=2, ensure_ascii=is_printed, allow_nan=False)
            if is_printed:
                print(text, flush=True)
            else:
                write_atomically(Path(json_file), (text + '\n').encode(), GravityCompError)
        return self.status


def _plain(value: Any) -> Any:
    """Return a value that JSON does not know in JSON types; a dataclass is its fields."""
    if is_dataclass(value):
        return {each.name: getattr(value, each.name) for each in fields(value)}
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, (set, frozenset)):
        return list(value)
    return value.tolist() if hasattr(value, 'tolist') else str(value)
