"""Tables for screens of any width, without truncated names or numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import re
import textwrap

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

# Minimum width of a column of folded text, in characters.
_MIN_TEXT_WIDTH = 16
# Maximum number of side-by-side splits; beyond it, rows become lines of `column: value`.
_MAX_PARTS = 3
_GAP, _TIGHT_GAP = 3, 1
# Unbreakable parts of a line: a word, or a number with its unit.
_WORD = re.compile(r'\S+(?: (?:N·m(?:/\S+)?|rad/s|rad|Hz|kg|mm|ms|s|%|°)(?![^\s,;:.)]))?')


@dataclass(frozen=True)
class _Column:
    """A heading and its cells; `text` columns are aligned left, `folds` allows line breaks."""

    heading: str
    cells: tuple[Text, ...]
    text: bool
    folds: bool

    def min_width(self, one_line: bool) -> int:
        """Return the minimum width in characters, with the heading on one line or broken."""
        words = self.heading.splitlines() if one_line else self.heading.split()
        widest = max((cell_len(cell.plain) for cell in self.cells), default=0)
        if self.folds and not one_line:
            widest = min(widest, _MIN_TEXT_WIDTH)
        return max([widest, *(cell_len(word) for word in words)])

    def heading_lines(self, width: int) -> str:
        """Return the heading broken between words."""
        lines = self.heading.splitlines()
        return '\n'.join(part for line in lines for part in textwrap.wrap(line, width))


@dataclass(frozen=True)
class ScreenTable:
    """
    A table; the first `keys` columns identify a row.

    On a narrow screen, headings are broken first, then columns move closer, then the table is
    split into several with the same keys, then each cell becomes a line.

    :param left: text columns in addition to the first; the others are numbers.
    :param folds: columns whose text may be broken into lines.
    """

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[Text]]
    left: Sequence[str] = ()
    folds: Sequence[str] = ()
    keys: int = 1

    def natural_width(self) -> int:
        """Return the width without any line breaks."""
        return _width(self._columns(), one_line=True, gap=_GAP)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        columns, width = self._columns(), options.max_width
        for one_line, gap in ((True, _GAP), (False, _GAP), (False, _TIGHT_GAP)):
            if _width(columns, one_line, gap) <= width:
                yield self._table(columns, one_line, gap, self.title)
                return
        parts = list(_parts(columns, self.keys, width))
        if len(parts) > _MAX_PARTS or any(_width(p, False, _GAP) > width for p in parts):
            yield from self._lines(columns, width)
            return
        for number, part in enumerate(parts):
            yield self._table(part, False, _GAP, self.title if number == 0 else '')

    def _columns(self) -> list[_Column]:
        return [_Column(heading, tuple(row[k] for row in self.rows),
                        k == 0 or heading in self.left, heading in self.folds)
                for k, heading in enumerate(self.headings)]

    def _table(self, columns: Sequence[_Column], one_line: bool, gap: int, title: str
               ) -> Table:
        table = Table(title=Text(title) if title else None, title_justify='left',
                      box=box.SIMPLE_HEAD, title_style='bold', pad_edge=False,
                      padding=(0, 1 if gap == _GAP else 0))
        for column in columns:
            # Only columns with line breaks shrink.
            heading = column.heading_lines(column.min_width(one_line))
            table.add_column(Text(heading), justify='left' if column.text else 'right',
                             no_wrap=not column.folds, overflow='fold',
                             min_width=column.min_width(one_line=False))
        for cells in zip(*(column.cells for column in columns)):
            table.add_row(*cells)
        return table

    def _lines(self, columns: Sequence[_Column], width: int) -> Iterator[Text]:
        """Yield each row as several lines, keys first."""
        if self.title:
            yield Text(self.title, style='bold')
        name_width = max(cell_len(column.heading) for column in columns) + 3
        for row in self.rows:
            keys = Text('  ').join(row[:self.keys])
            keys.stylize('bold')
            yield _folding(keys)
            for column, cell in zip(columns[self.keys:], row[self.keys:]):
                name = Text(f'  {column.heading}'.ljust(name_width))
                short = name_width + cell_len(cell.plain) <= width
                yield _folding(name + cell if short else Text(f'  {column.heading}  ') + cell)


def _width(columns: Sequence[_Column], one_line: bool, gap: int) -> int:
    return sum(column.min_width(one_line) for column in columns) + gap * len(columns)


def _parts(columns: list[_Column], keys: int, width: int) -> Iterator[list[_Column]]:
    """Yield groups of columns that fit into the width, each with the keys."""
    head, part = columns[:keys], list[_Column]()
    for column in columns[keys:]:
        if part and _width([*head, *part, column], False, _GAP) > width:
            yield [*head, *part]
            part = []
        part.append(column)
    yield [*head, *part]


def _folding(text: Text) -> Text:
    text.no_wrap, text.overflow = False, 'fold'
    return text


def wrapped(line: Text, width: int, indent: int = 4) -> list[Text]:
    """Return a line broken between words, with continuation lines indented further."""
    lead = len(line.plain) - len(line.plain.lstrip())
    if cell_len(line.plain) <= width or width - lead < 4 * indent:
        return [line]
    breaks: list[int] = []
    for word in _WORD.finditer(line.plain):
        begin, column = (breaks[-1], lead + indent) if breaks else (lead, lead)
        if word.start() > begin and column + cell_len(line.plain[begin:word.end()]) > width:
            breaks.append(word.start())
    first, *rest = line.divide(breaks)
    for part in (first, *rest):
        part.rstrip()
    return [first, *(Text(' ' * (lead + indent)) + part for part in rest)]
